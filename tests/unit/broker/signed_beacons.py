"""A member whose beacons are signed now and then, as datagrams for `Sources`."""

from typing import Final

import msgspec

from swarmd.broker.core.admission.own_signatures import OwnSignatures
from swarmd.broker.core.admission.sources import SealedDatagram
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, BoardValue, Header, Hello, PlatformCode
from swarmd.broker.core.beacon.beacon_history import datagram_digest
from swarmware.model.names import hardware_id
from swarmware.transport.sodium import KEY_BYTES, SigningKey

SESSION: Final = 77
HOST: Final = "10.0.0.7"


class MemberKeys:
    """Signing keys of a member of uav1, uav2 and uav3."""

    is_open = False

    def __init__(self, name: str) -> None:
        self._name = name

    def sign(self, data: bytes) -> bytes:
        return _key(self._name).sign(data)

    def sign_public_of(self, platform: str) -> bytes | None:
        return _key(platform).public if platform in {"uav1", "uav2", "uav3"} else None


def _key(name: str) -> SigningKey:
    return SigningKey(name.encode().ljust(KEY_BYTES))


class SealedBeacon(msgspec.Struct, frozen=True):
    """A beacon after its seal was opened."""

    header: Header
    beacon: Beacon
    datagram: SealedDatagram


class Member:
    """Sends beacons; one that forges has the name of its victim and a key of its own."""

    def __init__(self, name: str, *, key: str = "", session: int = SESSION, host: str = HOST) -> None:
        self.name = name
        self.hw = hardware_id(name)
        self.session = session
        self.host = host
        self.signatures = OwnSignatures(self.hw, session, MemberKeys(key or name))

    def beacon(
        self, sequence: int, now_ns: int, *, signed: bool | None = None, content: bytes = b"true"
    ) -> SealedBeacon:
        """The beacon with this number; `signed`: None as it is due."""
        header = Header(0, self.hw, sequence, now_ns // 1000 & 0xFFFF_FFFF, self.session)
        clear = codec.encode_header(header)
        hello = Hello(1, 0, 0, 0, 0, PlatformCode.UAV, self.name, period_ms=100)
        values = (BoardValue(1, 0, True, content),)
        body = codec.encode(Beacon(hello=hello, values=values))
        if signed or (signed is None and self.signatures.reserved_bytes(now_ns)):
            body = self.signatures.signed(sequence, clear, body, values, now_ns)
        digest = datagram_digest(clear + body)
        self.signatures.on_sent(sequence, digest)
        return SealedBeacon(header, codec.decode(body), SealedDatagram(clear, body, digest, self.host, True))
