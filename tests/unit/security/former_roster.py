"""Rosters of a former version, in which not every beacon was signed."""

from swarmware.transport.sodium import SigningKey


def former(text: bytes, root: SigningKey) -> bytes:
    """The same members in a roster as a root of a former version signed it, with a higher version."""
    body = text.split(b"\n")[0].replace(b',"sign_beacons":true', b"").replace(b'n":1', b'n":9')
    return body + b"\n" + root.sign(body).hex().encode() + b"\n"
