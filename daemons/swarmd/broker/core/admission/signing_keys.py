"""The keys with which a node signs, and checks what other members have signed."""

from typing import Protocol


class SigningKeys(Protocol):
    """The own signing key, and the public keys of the members."""

    @property
    def is_open(self) -> bool:
        """Whether there are no keys."""
        ...

    def sign(self, data: bytes) -> bytes:
        """Signature by this node."""
        ...

    def sign_public_of(self, platform: str) -> bytes | None:
        """Public key of a member; None: it is not a valid member."""
        ...
