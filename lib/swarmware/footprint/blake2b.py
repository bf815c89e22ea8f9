"""BLAKE2b, as `hashlib` has it, without `hashlib`: that loads OpenSSL, 3.5 MB of resident memory."""

try:
    from _blake2 import blake2b
except ImportError:  # an interpreter other than CPython
    from hashlib import blake2b

__all__ = ["blake2b"]
