"""Several media to one neighbour: copies, loss in both directions, and the choice."""

from collections.abc import Mapping
from types import MappingProxyType

import pytest

from swarmd.broker.config import Carries, Config, NetworkMedium, SerialMedium
from swarmd.broker.core.beacon.beacon import Header
from swarmd.broker.core.beacon.parts.medium_parts import LISTING_BYTES, MediumListing
from swarmd.broker.core.swarm.links.link import LinkState
from swarmd.broker.core.swarm.media.medium import COST_MAX, MAIN_MEDIUM, MediumProfile
from swarmd.broker.core.swarm.media.medium_link import MediumLink
from swarmd.broker.core.swarm.neighbour import Neighbour
from swarmd.broker.core.swarm.neighbours.medium_table import (
    FORGET_NS,
    LISTING_NS,
    ByMedium,
    MediumTable,
    Use,
    connection_host,
    media_of,
)
from swarmd.broker.core.swarm.neighbours.neighbour_table import NeighbourTable

SECOND = 1_000_000_000
PERIOD = SECOND // 10
OWN, OTHER, THIRD = 1, 2, 3
RADIO = MediumProfile("radio")
SECOND_RADIO = MediumProfile("radio2")
VIDEO = MediumProfile("video", Carries.PAYLOAD)
MODEM = MediumProfile("modem", Carries.ALL, 46_080.0, has_connections=False)
TELEMETRY = MediumProfile("telemetry", Carries.CONTROL, 46_080.0, has_connections=False)


class Ends:
    """A table, and a neighbour whose beacons come over some of its media."""

    def __init__(self, *media: MediumProfile) -> None:
        self.neighbours = NeighbourTable(OWN, SECOND)
        self.table = MediumTable(OWN, media, SECOND, self.neighbours)
        self.now_ns = 0
        self.sequence = 0
        self.changes = 0

    @property
    def neighbour(self) -> Neighbour:
        found = self.neighbours.get(OTHER)
        assert found is not None
        return found

    def receive(
        self,
        *media: MediumProfile,
        hw: int = OTHER,
        session: int = 1,
        qualities: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """A beacon arrives over these media; the neighbour lists how well it receives this node by which."""
        header = Header(0, hw, self.sequence, 0, session)
        for medium in media:
            by = ByMedium(medium, self.sequence)
            if self.table.is_copy(header, by):
                self.table.on_copy(hw, by, ("host", 7), self.now_ns)
                continue
            known = self.neighbours.get(hw)
            restarted = known is not None and known.session != session
            neighbour = self.neighbours.on_header(header, restarted, ("host", 7), self.now_ns, [])
            assert neighbour is not None
            neighbour.session, neighbour.period_ns = session, PERIOD
            self.table.on_beacon(neighbour, by, ("host", 7), self.listings(qualities), self.now_ns)

    def listings(self, qualities: Mapping[str, float]) -> list[MediumListing]:
        by_name = {medium.name: number for number, medium in self.table.media.items()}
        return [MediumListing(OWN, by_name[name], round(255 * share)) for name, share in qualities.items()]

    def run(self, seconds: float, *media: MediumProfile, **qualities: float) -> None:
        """Beacons over these media, with listings, for a time."""
        for _ in range(round(10 * seconds)):
            self.now_ns += PERIOD
            self.sequence += 1
            self.receive(*media, qualities=qualities)
            self.changes += len(self.table.advance(self.now_ns))

    def host(self) -> str:
        """Address of the connections to the neighbour."""
        known = self.neighbours.get(OTHER)
        return "" if known is None else connection_host(known)

    def chosen(self) -> list[str]:
        return [way.medium.name for way in self.table.ways(OTHER, Use.PACKETS, self.now_ns)]

    def urgent(self) -> set[str]:
        return {way.medium.name for way in self.table.ways(OTHER, Use.URGENT, self.now_ns)}


def test_second_copy_of_beacon_is_known_as_one() -> None:
    ends = Ends(RADIO, SECOND_RADIO)

    def is_first(sequence: int, session: int = 1, hw: int = OTHER) -> bool:
        return not ends.table.is_copy(Header(0, hw, sequence, 0, session), ByMedium(RADIO, sequence))

    assert is_first(5)
    ends.sequence = 5
    ends.receive(RADIO)
    assert not is_first(5)
    assert is_first(4), "overtaken, not copied"
    assert is_first(6)
    assert is_first(5, session=2), "of another session"
    assert is_first(5, hw=THIRD)
    ends.sequence = 500
    ends.receive(RADIO)
    assert not is_first(500)
    assert not is_first(436), "as old as what the replay window refuses"


def test_packets_take_best_medium_and_urgent_take_all() -> None:
    ends = Ends(RADIO, SECOND_RADIO)
    ends.run(4, RADIO, SECOND_RADIO, radio=0.6, radio2=0.95)
    assert ends.chosen() == ["radio2"]
    assert ends.urgent() == {"radio", "radio2"}


def test_each_direction_is_chosen_by_its_receptions() -> None:
    ends = Ends(RADIO, SECOND_RADIO)
    for _ in range(40):  # radio2 brings little to here, but all of ours there
        ends.run(0.1, RADIO, radio=0.6, radio2=0.95)
        ends.run(0.1, RADIO, SECOND_RADIO, radio=0.6, radio2=0.95)
    assert ends.chosen() == ["radio2"]
    listed = {one.medium: one.quality for one in ends.table.listings(ends.now_ns, 1000)}
    assert listed[RADIO.number] == 255
    assert listed[SECOND_RADIO.number] == pytest.approx(128, abs=9)


def test_choice_stays_until_another_medium_is_clearly_better() -> None:
    ends = Ends(RADIO, SECOND_RADIO)
    ends.run(2, RADIO, SECOND_RADIO, radio=0.9, radio2=0.88)
    assert ends.chosen() == ["radio"]
    ends.run(2, RADIO, SECOND_RADIO, radio=0.88, radio2=0.9)
    assert ends.chosen() == ["radio"]
    ends.run(2, RADIO, SECOND_RADIO, radio=0.6, radio2=0.9)
    assert ends.chosen() == ["radio2"]
    assert ends.changes == 2


def test_slow_line_is_used_only_without_radio() -> None:
    ends = Ends(RADIO, MODEM)
    ends.run(2, RADIO, MODEM, radio=0.5, modem=1.0)
    assert ends.chosen() == ["radio"], "half of the packets of a radio are more than a line carries"
    assert ends.host() == "host"
    ends.run(1.1, MODEM, modem=1.0)
    assert ends.chosen() == ["modem"]
    assert ends.host() == "", "nothing connects to a line"
    assert ends.neighbour.penalty == MODEM.rate_penalty
    ends.run(1, RADIO, MODEM, radio=0.5, modem=1.0)
    assert ends.chosen() == ["radio"]
    assert ends.neighbour.penalty == 0


def test_a_medium_in_one_direction_is_not_used() -> None:
    ends = Ends(RADIO, MODEM)
    ends.run(2, RADIO, MODEM, radio=1.0, modem=1.0)
    ends.run(0.5, RADIO, MODEM, radio=0.0, modem=1.0)
    assert ends.chosen() == ["modem"]
    assert ends.urgent() == {"modem"}
    ends.run(1, RADIO, MODEM, radio=1.0, modem=1.0)
    assert ends.chosen() == ["radio"]
    ends.run(4, RADIO, MODEM, modem=1.0)
    assert ends.chosen() == ["modem"], "the neighbour does not say any more that it receives by the radio"


def test_a_silent_medium_is_found_at_its_deadline() -> None:
    ends = Ends(RADIO, MODEM)
    ends.run(2, RADIO, MODEM, radio=1.0, modem=1.0)
    due_ns = ends.table.deadline_ns(ends.now_ns)
    assert due_ns == ends.now_ns + SECOND
    ends.sequence += 1
    ends.now_ns += PERIOD
    ends.receive(MODEM)
    assert ends.table.advance(due_ns) == [OTHER]


def test_payload_link_takes_packets_and_no_commands() -> None:
    ends = Ends(RADIO, VIDEO)
    ends.run(2, RADIO, VIDEO, radio=1.0, video=0.8)
    assert ends.chosen() == ["video"]
    assert ends.urgent() == {"radio"}
    ends.run(1.1, RADIO, radio=1.0)
    assert ends.chosen() == ["radio"]


def test_control_link_takes_packets_as_last_resort() -> None:
    ends = Ends(RADIO, TELEMETRY)
    ends.run(2, RADIO, TELEMETRY, radio=0.3, telemetry=1.0)
    assert ends.chosen() == ["radio"]
    assert ends.urgent() == {"radio", "telemetry"}
    ends.run(1.1, TELEMETRY, telemetry=1.0)
    assert ends.chosen() == ["telemetry"]


def test_a_new_session_begins_with_no_medium() -> None:
    ends = Ends(RADIO, MODEM)
    ends.run(2, RADIO, MODEM, radio=1.0, modem=1.0)
    ends.receive(MODEM)
    ends.receive(MODEM, session=2)
    assert list(ends.neighbour.media) == [MODEM.number]
    ends.table.advance(ends.now_ns)
    assert ends.chosen() == []


def test_every_medium_is_listed_even_when_silent() -> None:
    ends = Ends(RADIO, MODEM)
    ends.run(3, RADIO, MODEM)
    first = ends.table.listings(ends.now_ns, 1000)
    assert {(one.hw, one.medium) for one in first} == {(OTHER, RADIO.number), (OTHER, MODEM.number)}
    assert ends.table.listings(ends.now_ns + LISTING_NS - 1, 1000) == ()
    ends.run(2, RADIO)
    listed = {one.medium: one.quality for one in ends.table.listings(ends.now_ns, 1000)}
    assert listed == {RADIO.number: 255, MODEM.number: 0}


def test_beacon_rate_suits_medium_of_each_neighbour() -> None:
    ends = Ends(RADIO, MODEM)
    alone_hz = ends.table.beacon_hz(100, 0)
    assert alone_hz > 50, "while nobody is received the fast medium decides"
    ends.run(1, RADIO, MODEM)
    assert ends.table.beacon_hz(100, ends.now_ns) == alone_hz
    ends.receive(MODEM, hw=THIRD)
    assert ends.table.beacon_hz(100, ends.now_ns) == pytest.approx(0.5 * 57_600 / 10 / 109, rel=0.02)


@pytest.mark.parametrize(("baud", "hops"), [(921_600, 0.5), (57_600, 8.7), (9_600, 32.0)])
def test_slow_medium_costs_as_much_as_radio_hops(baud: int, hops: float) -> None:
    medium = MediumProfile("line", rate_bit_s=0.8 * baud)
    assert medium.rate_penalty / 256 == pytest.approx(hops, abs=0.2)
    assert medium.rate_penalty <= COST_MAX


def test_neighbour_without_media_list_has_main_network_alone() -> None:
    ends = Ends(MAIN_MEDIUM, SECOND_RADIO)
    ends.run(1, MAIN_MEDIUM)
    assert ends.chosen() == []
    ends.neighbour.state, ends.neighbour.reported = LinkState.UP, 204
    ends.run(0.1, MAIN_MEDIUM)
    assert ends.chosen() == ["main"]
    assert ends.neighbour.media[MAIN_MEDIUM.number].quality_out(ends.now_ns) == 204
    ends.neighbour.reported = 0
    ends.run(0.1, MAIN_MEDIUM)
    assert ends.chosen() == [], "it does not receive this node"


def test_report_on_all_media_implies_nothing_for_one() -> None:
    ends = Ends(MAIN_MEDIUM, SECOND_RADIO)
    ends.run(1, MAIN_MEDIUM, SECOND_RADIO, main=0.0, radio2=1.0)
    ends.neighbour.state, ends.neighbour.reported = LinkState.UP, 255
    ends.run(0.1, MAIN_MEDIUM, SECOND_RADIO)
    assert ends.chosen() == ["radio2"]
    assert ends.urgent() == {"radio2"}


def test_connections_follow_last_reception_until_neighbour_reports() -> None:
    ends = Ends(RADIO, MODEM)
    assert ends.host() == ""
    ends.run(1, MODEM)
    assert ends.host() == "", "nothing connects to a line"
    ends.run(1, RADIO, MODEM)
    assert ends.host() == "host", "over it, its session is proven"


def test_every_link_is_listed_over_several_beacons() -> None:
    ends = Ends(RADIO, SECOND_RADIO)
    for hw in range(10, 40):
        ends.receive(RADIO, SECOND_RADIO, hw=hw)
    listed = [ends.table.listings(number * LISTING_NS, 25 * LISTING_BYTES) for number in range(3)]
    assert [len(one) for one in listed] == [25, 25, 25]
    assert len({(one.hw, one.medium) for part in listed for one in part}) == 60
    assert ends.table.listings(3 * LISTING_NS, 0) == ()


@pytest.mark.parametrize(("lost", "periods"), [(0, 2.5), (9, 4.8), (20, 6.0)])
def test_lossy_medium_is_silent_after_more_missing_beacons(lost: int, periods: float) -> None:
    link = MediumLink(RADIO, SECOND)
    arrived = [number for number in range(33) if not (number and number <= lost)]
    for number in arrived:
        link.on_arrival(number, ("host", 7), SECOND, 0)
    assert link.deadline_ns == pytest.approx(periods * SECOND, rel=0.02)


def test_hundreds_of_links_are_listed_within_period() -> None:
    ends = Ends(RADIO, SECOND_RADIO)
    for hw in range(10, 210):
        ends.receive(RADIO, SECOND_RADIO, hw=hw)
    beacons = [ends.table.listings(number * PERIOD, 35 * LISTING_BYTES) for number in range(50)]
    assert {len(one) for one in beacons} == {35}
    last = {(one.hw, one.medium): 0 for one in beacons[0]}
    for number, listings in enumerate(beacons):
        for one in listings:
            assert number - last.get((one.hw, one.medium), 0) < 25, "2.5 s without a listing: half open"
            last[one.hw, one.medium] = number
    assert len(last) == 400


def test_small_table_is_listed_once_in_period() -> None:
    ends = Ends(RADIO, SECOND_RADIO)
    for hw in range(10, 30):
        ends.receive(RADIO, SECOND_RADIO, hw=hw)
    sizes = [len(ends.table.listings(number * PERIOD, 25 * LISTING_BYTES)) for number in range(8)]
    assert sizes == [25, 15, 0, 0, 25, 15, 0, 0]


def test_beacon_over_payload_link_is_always_copy() -> None:
    ends = Ends(RADIO, VIDEO)
    ends.sequence = 5
    header = Header(0, OTHER, 5, 0, 1)
    assert ends.table.is_copy(header, ByMedium(VIDEO, 1))
    assert not ends.table.is_copy(header, ByMedium(RADIO, 5))
    ends.receive(RADIO)
    assert ends.table.is_copy(header, ByMedium(RADIO, 5))


def test_the_medium_of_arriving_packets_is_noted() -> None:
    ends = Ends(RADIO, SECOND_RADIO)
    ends.run(2.0, RADIO, SECOND_RADIO, radio=1.0, radio2=1.0)
    ends.table.on_frames(OTHER, RADIO.number, ends.now_ns)
    ends.table.on_frames(THIRD, RADIO.number, ends.now_ns)
    noted = {link.medium.name for link in ends.neighbour.media.values() if link.frames_ns == ends.now_ns}
    assert noted == {"radio"}


def test_neighbour_silent_on_all_media_is_forgotten() -> None:
    ends = Ends(RADIO)
    ends.run(2.0, RADIO, radio=1.0)
    assert ends.urgent() == {"radio"}
    ends.now_ns += FORGET_NS + SECOND
    ends.table.advance(ends.now_ns)
    assert not ends.neighbour.media
    assert ends.urgent() == set()


def test_a_listing_alone_makes_no_link() -> None:
    ends = Ends(RADIO, MODEM)
    ends.run(0.1, MODEM, radio=1.0, modem=1.0)
    assert list(ends.neighbour.media) == [MODEM.number]


def test_address_on_main_network_survives_other_media() -> None:
    ends = Ends(MAIN_MEDIUM, MODEM)
    ends.run(0.1, MODEM)
    header, by = Header(0, OTHER, 9, 0, 1), ByMedium(MODEM, 9)
    assert ends.table.address_on_main(header, by, ("modem", 0)) == ("modem", 0), "not received there yet"
    ends.run(0.1, MAIN_MEDIUM)
    assert ends.table.address_on_main(header, by, ("modem", 0)) == ("host", 7)
    header.session = 2
    assert ends.table.address_on_main(header, by, ("modem", 0)) == ("modem", 0), "of another session"


def test_rate_of_chosen_medium_adds_to_cost() -> None:
    ends = Ends(MODEM)
    ends.run(2.0, MODEM, modem=1.0)
    assert ends.neighbour.penalty == MODEM.rate_penalty > 0
    ends.receive(MODEM, session=2)
    assert ends.neighbour.penalty == 0, "of the former session"


def test_a_configuration_with_further_media_makes_a_table() -> None:
    assert media_of(OWN, Config(), NeighbourTable(OWN, SECOND)) is None
    config = Config(
        network=(NetworkMedium(name="wide", interface="wlan1"),),
        serial=(SerialMedium(name="modem", device="/dev/ttyUSB0"),),
    )
    table = media_of(OWN, config, NeighbourTable(OWN, SECOND))
    assert table is not None
    assert {medium.name for medium in table.media.values()} == {MAIN_MEDIUM.name, "wide", "modem"}
