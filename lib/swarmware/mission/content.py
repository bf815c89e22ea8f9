"""The hash that identifies the content of a mission."""

from hashlib import blake2b


def content_hash(*parts: str) -> str:
    """BLAKE2b-128 of the texts, each with its length, hex."""
    state = blake2b(digest_size=16)
    for part in parts:
        data = part.encode()
        state.update(len(data).to_bytes(8, "little"))
        state.update(data)
    return state.hexdigest()
