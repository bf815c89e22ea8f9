"""Proof that a node holds the key with which it joins, and the check of the swarm's root."""

from typing import Final

from swarmware.model.digest import blake2b
from swarmware.transport.sodium import SigningKey, verify

FINGERPRINT_BYTES: Final = 16
_JOIN: Final = b"swarmware join 1\n"


def root_digest(root_public: bytes) -> bytes:
    """The digest of a root's public key, by which tokens and operators name it."""
    return blake2b(root_public, digest_size=FINGERPRINT_BYTES).digest()


def fingerprint(root_public: bytes) -> str:
    """The digest by which people and tokens name a root."""
    return root_digest(root_public).hex()


def proof_of(key: SigningKey, root: bytes, platform: str) -> bytes:
    """The proof that a node holds its key: a signature for this platform and the root of this fingerprint."""
    return key.sign(_JOIN + root + platform.encode())


def proves(sign_public: bytes, proof: bytes, root: bytes, platform: str) -> bool:
    """Whether the holder of a public key made this proof.

    Raises: InvalidInput when the key has another size.
    """
    return verify(sign_public, proof, _JOIN + root + platform.encode())
