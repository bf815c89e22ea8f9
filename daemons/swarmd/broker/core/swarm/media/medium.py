"""A medium as the core knows it, with number, rate and the frames that it carries."""

from functools import lru_cache
from typing import Final

import msgspec

from swarmd.broker.config import MAIN, Carries, NetworkMedium, SerialMedium
from swarmd.broker.core.swarm.media.line_frames import BITS, line_bytes
from swarmware.footprint.blake2b import blake2b
from swarmware.types.net import LinkTransport

BEACON_SHARE: Final = 0.5
"""Share of a medium of known rate for the beacons of this node."""
NOMINAL_BYTES: Final = 500
"""Frame whose time on a medium is its cost."""
PENALTY_NS: Final = 10_000_000
"""Time of the nominal frame that costs as much as a hop without loss: so a line of 57 600 baud is chosen
where radios need eight hops."""
PERFECT: Final = 256
"""Cost of a medium without loss whose rate is not known."""
COST_MAX: Final = 8192

Address = tuple[str, int]


class MediumProfile(msgspec.Struct, frozen=True):
    """One way on which datagrams leave and arrive."""

    name: str
    carries: Carries = Carries.ALL
    rate_bit_s: float = 0.0
    """Configured rate, or 0 if not known, as for a radio or network."""
    has_connections: bool = True
    """ZeroMQ can connect to the addresses of this medium."""

    @property
    def number(self) -> int:
        """Number in beacons, derived from the name, which is the same at both ends of a medium."""
        return medium_number(self.name)

    @property
    def transport(self) -> LinkTransport:
        """Kind of the medium in the counters of traffic."""
        return LinkTransport.UDP if self.has_connections else LinkTransport.SERIAL

    def counted_bytes(self, datagram_bytes: int) -> int:
        """Bytes of a datagram for the counters: of UDP without headers, on a line with its framing."""
        return datagram_bytes if self.has_connections else line_bytes(datagram_bytes)

    @property
    def rate_penalty(self) -> int:
        """Cost of the time that the nominal frame takes."""
        if not self.rate_bit_s:
            return 0
        return min(round(PERFECT * 8e9 * NOMINAL_BYTES / self.rate_bit_s / PENALTY_NS), COST_MAX)


MAIN_MEDIUM: Final = MediumProfile(MAIN)


def network_medium(config: NetworkMedium) -> MediumProfile:
    """A network beside the main one."""
    return MediumProfile(config.name, config.carries, config.rate_bit_s)


def serial_medium(config: SerialMedium) -> MediumProfile:
    """The medium of a serial line."""
    return MediumProfile(config.name, config.carries, 8 / BITS * config.baud, has_connections=False)


@lru_cache(maxsize=256)
def medium_number(name: str) -> int:
    """BLAKE2b-16 of the name of a medium."""
    return int.from_bytes(blake2b(name.encode(), digest_size=2).digest(), "little")
