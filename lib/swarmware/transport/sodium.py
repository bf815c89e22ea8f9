"""The primitives of cryptography, from libsodium: Ed25519, X25519, SHA-512 and ChaCha20-Poly1305 (RFC 8439).

libsodium takes 1 MB of resident memory, the OpenSSL within the package `cryptography` ten. `nacl._sodium`
is called directly: the checks of `nacl.bindings` take three times as long as the cipher itself. It reads
through pointers, so every length is checked here.
"""

from typing import Final

from nacl._sodium import ffi, lib

from swarmware.errors import InvalidInput, SwarmError

KEY_BYTES: Final = 32
"""Size of each key and seed, public and secret."""
NONCE_BYTES: Final = 12
TAG_BYTES: Final = 16
SIGNATURE_BYTES: Final = 64
BOX_BYTES: Final = 48
"""Bytes that `seal_box` adds: a public key made for this box, and a tag."""
_SHA512_BYTES: Final = 64

if lib.sodium_init() < 0:
    raise SwarmError("libsodium cannot be initialised: no source of random numbers")

_new = ffi.new
_buffer = ffi.buffer
_NULL = ffi.NULL
_encrypt = lib.crypto_aead_chacha20poly1305_ietf_encrypt
_decrypt = lib.crypto_aead_chacha20poly1305_ietf_decrypt


class SealKey:
    """A secret key that seals and opens datagrams with ChaCha20-Poly1305."""

    __slots__ = ("_key",)

    def __init__(self, key: bytes) -> None:
        """Raises: InvalidInput when the key has another size."""
        self._key = _sized(key, KEY_BYTES, "a key")

    def seal(self, nonce: bytes, body: bytes, clear: bytes) -> bytes:
        """The body encrypted, with a tag over it and `clear`. A nonce is used once with a key.

        Raises: InvalidInput when the nonce has another size.
        """
        if len(nonce) != NONCE_BYTES:
            raise InvalidInput(f"a nonce of {len(nonce)} bytes; expected {NONCE_BYTES}")
        size = len(body)
        box = _new("unsigned char[]", size + TAG_BYTES)
        _encrypt(box, _NULL, body, size, clear, len(clear), _NULL, nonce, self._key)
        sealed: bytes = _buffer(box)[:]
        return sealed

    def open(self, nonce: bytes, box: bytes, clear: bytes) -> bytes | None:
        """The decrypted body, or None if another key sealed it or it was changed.

        Raises: InvalidInput when the nonce has another size.
        """
        if len(nonce) != NONCE_BYTES:
            raise InvalidInput(f"a nonce of {len(nonce)} bytes; expected {NONCE_BYTES}")
        size = len(box)
        if size < TAG_BYTES:
            return None
        body = _new("unsigned char[]", size - TAG_BYTES)
        if _decrypt(body, _NULL, _NULL, box, size, clear, len(clear), nonce, self._key):
            return None
        opened: bytes = _buffer(body)[:]
        return opened


class SigningKey:
    """An Ed25519 key pair, made of a seed."""

    def __init__(self, seed: bytes) -> None:
        """Raises: InvalidInput when the seed has another size."""
        public, secret = _new("unsigned char[]", KEY_BYTES), _new("unsigned char[]", 2 * KEY_BYTES)
        _done(lib.crypto_sign_seed_keypair(public, secret, _sized(seed, KEY_BYTES, "a seed")))
        self.seed = seed
        self.public: bytes = _buffer(public)[:]
        self._secret = secret

    def sign(self, data: bytes) -> bytes:
        """The Ed25519 signature of the data."""
        signed = _new("unsigned char[]", SIGNATURE_BYTES + len(data))
        _done(lib.crypto_sign(signed, _NULL, data, len(data), self._secret))
        signature: bytes = _buffer(signed, SIGNATURE_BYTES)[:]
        return signature


def verify(public: bytes, signature: bytes, data: bytes) -> bool:
    """Whether the owner of an Ed25519 public key signed the data.

    Raises: InvalidInput when the key has another size.
    """
    _sized(public, KEY_BYTES, "a public key")
    if len(signature) != SIGNATURE_BYTES:
        return False
    signed = signature + data
    opened, size = _new("unsigned char[]", len(signed)), _new("unsigned long long *")
    return bool(lib.crypto_sign_open(opened, size, signed, len(signed), public) == 0)


def curve_public(secret: bytes) -> bytes:
    """The X25519 public key of a secret key. Raises: InvalidInput when it has another size."""
    public = _new("unsigned char[]", KEY_BYTES)
    _done(lib.crypto_scalarmult_base(public, _sized(secret, KEY_BYTES, "a secret key")))
    found: bytes = _buffer(public)[:]
    return found


def curve_shared(secret: bytes, public: bytes) -> bytes:
    """The secret that X25519 makes of the secret key of one end and the public key of the other.

    Raises: InvalidInput when a key has another size, or the public key is a point of low order.
    """
    shared = _new("unsigned char[]", KEY_BYTES)
    _sized(secret, KEY_BYTES, "a secret key")
    if lib.crypto_scalarmult(shared, secret, _sized(public, KEY_BYTES, "a public key")):
        raise InvalidInput("a public key of low order, which any secret key turns to zero")
    found: bytes = _buffer(shared)[:]
    return found


def curve_of_signing(public: bytes) -> bytes:
    """The X25519 form of an Ed25519 public key.

    Raises: InvalidInput when it has another size, or is not a point of the curve's large subgroup.
    """
    curve = _new("unsigned char[]", KEY_BYTES)
    if lib.crypto_sign_ed25519_pk_to_curve25519(curve, _sized(public, KEY_BYTES, "a public key")):
        raise InvalidInput("a public key that is not one of Ed25519")
    found: bytes = _buffer(curve)[:]
    return found


def seal_box(public: bytes, data: bytes) -> bytes:
    """The data encrypted for the owner of an X25519 public key, without a name of the sender.

    Raises: InvalidInput when the key has another size, or is a point of low order.
    """
    box = _new("unsigned char[]", len(data) + BOX_BYTES)
    if lib.crypto_box_seal(box, data, len(data), _sized(public, KEY_BYTES, "a public key")):
        raise InvalidInput("a public key of low order, which any secret key turns to zero")
    sealed: bytes = _buffer(box)[:]
    return sealed


def open_box(public: bytes, secret: bytes, box: bytes) -> bytes | None:
    """The data that `seal_box` encrypted for this key pair, or None for another key pair or changed data.

    Raises: InvalidInput when a key has another size.
    """
    _sized(public, KEY_BYTES, "a public key")
    _sized(secret, KEY_BYTES, "a secret key")
    if len(box) < BOX_BYTES:
        return None
    data = _new("unsigned char[]", len(box) - BOX_BYTES)
    if lib.crypto_box_seal_open(data, box, len(box), public, secret):
        return None
    opened: bytes = _buffer(data)[:]
    return opened


def sha512(data: bytes) -> bytes:
    """The SHA-512 digest of the data."""
    digest = _new("unsigned char[]", _SHA512_BYTES)
    _done(lib.crypto_hash_sha512(digest, data, len(data)))
    found: bytes = _buffer(digest)[:]
    return found


def _sized(value: bytes, size: int, what: str) -> bytes:
    if len(value) != size:
        raise InvalidInput(f"{what} of {len(value)} bytes; expected {size}")
    return value


def _done(code: int) -> None:
    """Raise an error for a call that cannot fail, because the sizes were checked."""
    if code:
        raise SwarmError(f"libsodium refused with code {code}")
