"""The token of an invitation: one word that an operator copies or types, with all that a node needs."""

import struct
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.footprint.blake2b import blake2b
from swarmware.transport.sodium import SigningKey, verify

SECRET_BYTES: Final = 16
FINGERPRINT_BYTES: Final = 16
HOSTS_MAX: Final = 4
"""Maximum hosts in a token: each IPv4 address lengthens it by eight characters."""
NAME_MAX: Final = 63
"""Maximum bytes of a host that is a name."""
TEXT_MAX: Final = 1024
"""Maximum characters of a text that is read as a token."""
ID_BYTES: Final = 8
EXAMPLE: Final = "expected the line that `swarmctl keys invite` printed"

_JOIN: Final = b"swarmware join 1\n"
_PERSON: Final = b"swarmware token1"
_VERSION: Final = 1
_CHECK_BYTES: Final = 4
_HEAD: Final = struct.Struct(f">B{SECRET_BYTES}s{FINGERPRINT_BYTES}sIHB")
_NAME: Final = 0x80
_ALPHABET: Final = "0123456789abcdefghjkmnpqrstvwxyz"
"""Base 32 without letters that are read as digits. Source: Crockford, Base 32."""
_VALUES: Final = {letter: value for value, letter in enumerate(_ALPHABET)} | {"o": 0, "i": 1, "l": 1}


class JoinToken(msgspec.Struct, frozen=True):
    """Token for a node that joins: a secret, the fingerprint of the root, and the inviter's addresses."""

    secret: bytes
    fingerprint: bytes
    """Fingerprint of the swarm's root."""
    expires_utc_s: int
    """End of its validity, by the inviter's wall clock."""
    hosts: tuple[str, ...] = ()
    """Addresses or names of the inviter's computer, or () if the invitation is in a file."""
    port: int = 0

    @property
    def number(self) -> bytes:
        """Number of the invitation, which does not reveal the secret."""
        return blake2b(b"number", key=self.secret, person=_PERSON, digest_size=ID_BYTES).digest()

    def key(self, purpose: bytes) -> bytes:
        """The key that seals one kind of message of this invitation."""
        return blake2b(purpose, key=self.secret, person=_PERSON, digest_size=32).digest()

    def text(self) -> str:
        """The token as an operator copies it.

        Raises: InvalidInput when it has too many hosts, or one is too long.
        """
        if len(self.hosts) > HOSTS_MAX:
            raise InvalidInput(f"{len(self.hosts)} addresses in a token; expected {HOSTS_MAX} at most")
        head = _HEAD.pack(
            _VERSION, self.secret, self.fingerprint, self.expires_utc_s, self.port, len(self.hosts)
        )
        body = head + b"".join(map(_packed, self.hosts))
        return _letters(body + _checksum(body))

    @classmethod
    def parse(cls, text: str) -> "JoinToken":
        """The token in a text; case, white space, `-`, and o for 0, i or l for 1 make no difference.

        Raises: InvalidInput with the reason: an invalid character, missing characters, a typing error.
        """
        data = _bytes(text)
        body, check = data[:-_CHECK_BYTES], data[-_CHECK_BYTES:]
        if len(body) < _HEAD.size:
            raise InvalidInput(f"token: its end is missing; {EXAMPLE}")
        if check != _checksum(body):
            raise InvalidInput(f"token: mistyped or incomplete, its checksum does not match; {EXAMPLE}")
        version, secret, fingerprint, expires_utc_s, port, count = _HEAD.unpack_from(body)
        if version != _VERSION:
            raise InvalidInput(
                f"token: version {version}; expected {_VERSION}: the two computers have different software"
            )
        hosts, at = [], _HEAD.size
        for _ in range(count):
            host, at = _unpacked(body, at)
            hosts.append(host)
        return cls(secret, fingerprint, expires_utc_s, tuple(hosts), port)


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


def _checksum(body: bytes) -> bytes:
    return blake2b(body, person=_PERSON, digest_size=_CHECK_BYTES).digest()


def _packed(host: str) -> bytes:
    try:
        address = ip_address(host)
    except ValueError:  # it is a name
        name = host.encode("ascii", "replace")
        if not 0 < len(name) <= NAME_MAX or b"?" in name:
            text = f"host {host!r}: expected an address, or a name of {NAME_MAX} ASCII letters at most"
            raise InvalidInput(text) from None
        return bytes([_NAME | len(name)]) + name
    return bytes([address.version]) + address.packed


def _unpacked(body: bytes, at: int) -> tuple[str, int]:
    """A host, and the place behind it."""
    tag = body[at] if at < len(body) else 0
    size = {4: 4, 6: 16}.get(tag, tag - _NAME)
    packed = body[at + 1 : at + 1 + size]
    if size <= 0 or len(packed) < size:
        raise InvalidInput(f"token: a host in it is damaged; {EXAMPLE}")
    if tag < _NAME:
        return str(IPv4Address(packed) if tag == 4 else IPv6Address(packed)), at + 1 + size
    return packed.decode("ascii", "replace"), at + 1 + size


def _letters(data: bytes) -> str:
    """Base 32 of the bytes; the bits behind the last one are zero."""
    count = -(-len(data) * 8 // 5)
    number = int.from_bytes(data, "big") << (count * 5 - len(data) * 8)
    return "".join(_ALPHABET[number >> (5 * place) & 31] for place in reversed(range(count)))


def _bytes(text: str) -> bytes:
    if len(text) > TEXT_MAX:
        raise InvalidInput(f"token: {len(text)} characters; {EXAMPLE}")
    number = count = 0
    for place, letter in enumerate(text, 1):
        if letter == "-" or letter.isspace():
            continue
        value = _VALUES.get(letter.lower())
        if value is None:
            raise InvalidInput(f"token: character {place} is {letter!r}, which no token contains; {EXAMPLE}")
        number, count = number << 5 | value, count + 1
    size = count * 5 // 8
    return (number >> (count * 5 - size * 8)).to_bytes(size, "big")
