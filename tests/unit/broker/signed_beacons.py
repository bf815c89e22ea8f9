"""A member and its signed beacons, as datagrams whose seals were opened."""

from typing import Final, NamedTuple

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, BoardValue, Header, Hello, PlatformCode
from swarmd.broker.core.membership.signatures.own_signatures import OwnSignatures
from swarmd.broker.core.membership.signatures.signature_checks import CheckedDatagram, SignatureChecks
from swarmware.model.names import hardware_id
from swarmware.transport.sodium import KEY_BYTES, SigningKey

SESSION: Final = 77
HOST: Final = "10.0.0.7"
NAMES: Final = {hardware_id(name): name for name in ("uav1", "uav2", "uav3")}


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


class SealedBeacon(NamedTuple):
    """A beacon after its seal was opened."""

    header: Header
    beacon: Beacon
    clear: bytes
    body: bytes
    host: str = HOST

    def checked(self, checks: SignatureChecks) -> CheckedDatagram:
        return checks.on_datagram(*self)


def checks_of(name: str, *, has_copies: bool = False) -> SignatureChecks:
    """The checks of a receiver that knows the names of the members."""
    return SignatureChecks(MemberKeys(name), lambda hw: NAMES.get(hw, ""), has_copies=has_copies)


class Member:
    """Sender of beacons; a forger has the name of its victim and a key of its own."""

    def __init__(self, name: str, *, key: str = "", session: int = SESSION, host: str = HOST) -> None:
        self.name = name
        self.hw = hardware_id(name)
        self.session = session
        self.host = host
        self.signatures = OwnSignatures(self.hw, session, MemberKeys(key or name))

    def beacon(
        self,
        sequence: int,
        now_ns: int,
        *values: bytes,
        is_signed: bool = True,
        hello: Hello | None = None,
    ) -> SealedBeacon:
        """The beacon with this number, and values of as many boards."""
        header = Header(0, self.hw, sequence, now_ns // 1000 & 0xFFFF_FFFF, self.session)
        clear = codec.encode_header(header)
        boards = tuple(BoardValue(1 + board, 1000, True, payload) for board, payload in enumerate(values))
        body = codec.encode(Beacon(hello=hello, values=boards))
        if is_signed:
            body = self.signatures.signed(clear, body, boards, now_ns // 1000)
        return SealedBeacon(header, codec.decode(body), clear, body, self.host)

    def hello(self) -> Hello:
        return Hello(1, 0, 0, 0, 0, PlatformCode.UAV, self.name, period_ms=100)
