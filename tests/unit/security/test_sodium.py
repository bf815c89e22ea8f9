"""The ciphers and signatures of libsodium, compared with OpenSSL."""

import hashlib

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from hypothesis import given
from hypothesis import strategies as st

from swarmware.transport.sodium import SealKey, SigningKey, curve_public, curve_shared, sha512, verify

KEYS = st.binary(min_size=32, max_size=32)
NONCES = st.binary(min_size=12, max_size=12)
DATA = st.binary(max_size=200)


@given(key=KEYS, nonce=NONCES, body=DATA, clear=DATA)
def test_seal_equals_openssls_and_opens_mutually(key: bytes, nonce: bytes, body: bytes, clear: bytes) -> None:
    box = SealKey(key).seal(nonce, body, clear)
    assert box == ChaCha20Poly1305(key).encrypt(nonce, body, clear)
    assert SealKey(key).open(nonce, box, clear) == body


@given(key=KEYS, box=DATA, clear=DATA)
def test_what_nobody_sealed_is_not_opened(key: bytes, box: bytes, clear: bytes) -> None:
    assert SealKey(key).open(bytes(12), box, clear) is None


@pytest.mark.parametrize("place", range(20))
def test_a_flipped_bit_of_a_box_is_detected(place: int) -> None:
    box = bytearray(SealKey(bytes(32)).seal(bytes(12), b"body", b"clear"))
    box[place] ^= 1
    assert SealKey(bytes(32)).open(bytes(12), bytes(box), b"clear") is None


@given(seed=KEYS, data=DATA)
def test_signature_and_public_key_are_those_of_openssl(seed: bytes, data: bytes) -> None:
    reference = Ed25519PrivateKey.from_private_bytes(seed)
    key = SigningKey(seed)
    assert key.public == reference.public_key().public_bytes_raw()
    assert key.sign(data) == reference.sign(data)
    assert verify(key.public, key.sign(data), data)
    assert not verify(key.public, key.sign(data), data + b".")
    assert not verify(key.public, key.sign(data)[:-1], data)


@given(one=KEYS, other=KEYS)
def test_both_ends_make_shared_secret_that_openssl_makes(one: bytes, other: bytes) -> None:
    reference = X25519PrivateKey.from_private_bytes(one)
    assert curve_public(one) == reference.public_key().public_bytes_raw()
    shared = curve_shared(one, curve_public(other))
    assert shared == curve_shared(other, curve_public(one))
    assert shared == reference.exchange(X25519PublicKey.from_public_bytes(curve_public(other)))


def test_public_key_of_low_order_gives_no_secret() -> None:
    for point in (bytes(32), b"\1" + bytes(31)):
        with pytest.raises(ValueError, match="low order"):
            curve_shared(bytes(range(32)), point)


@given(data=DATA)
def test_the_digest_is_that_of_openssl(data: bytes) -> None:
    assert sha512(data) == hashlib.sha512(data).digest()


@pytest.mark.parametrize("size", [0, 11, 13, 31, 33, 64])
def test_key_or_nonce_of_another_size_is_refused(size: int) -> None:
    given, key = bytes(size), bytes(32)
    with pytest.raises(ValueError, match=f"a key of {size} bytes; expected 32"):
        SealKey(given)
    with pytest.raises(ValueError, match=f"a nonce of {size} bytes; expected 12"):
        SealKey(key).seal(given, b"", b"")
    with pytest.raises(ValueError, match=f"a nonce of {size} bytes; expected 12"):
        SealKey(key).open(given, bytes(16), b"")
    with pytest.raises(ValueError, match=f"a seed of {size} bytes; expected 32"):
        SigningKey(given)
    with pytest.raises(ValueError, match=f"a public key of {size} bytes; expected 32"):
        verify(given, bytes(64), b"")
    with pytest.raises(ValueError, match=f"a secret key of {size} bytes; expected 32"):
        curve_public(given)
    with pytest.raises(ValueError, match=f"a secret key of {size} bytes; expected 32"):
        curve_shared(given, b"\x09" + bytes(31))
    with pytest.raises(ValueError, match=f"a public key of {size} bytes; expected 32"):
        curve_shared(key, given)
