"""The metrics page: what Prometheus reads from it, and what its server answers to anything else."""

from http import HTTPStatus

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from swarmd.broker.config import Config
from swarmd.broker.core.reports.metrics_page import metrics_page
from swarmd.broker.records.metrics_server import HttpAnswer, judge
from swarmware.errors import InvalidInput
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.net import ConnectionStatus, LinkStatus, LinkTransport, Neighbours, NeighbourState
from swarmware.types.outage import LinkOutage, OutageCause, OutagePhase, OutageTable
from swarmware.types.traffic import ChannelTraffic, LinkTraffic, Refused, Traffic

Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def samples(text: str) -> Samples:
    """What Prometheus's own parser reads; it refuses a page against the specification."""
    return {
        (one.name, frozenset(one.labels.items())): one.value
        for family in text_string_to_metric_families(text)  # type: ignore[no-untyped-call]  # it has no types
        for one in family.samples
    }


def read(found: Samples, name: str, **labels: str) -> float:
    return found[name, frozenset({"node": "uav1", **labels}.items())]


def traffic(**fields: object) -> Traffic:
    return msgspec.structs.replace(msgspec.convert([0] * 16 + [1.0, []], Traffic), **fields)


def neighbour(name: str, state: LinkStatus, rtt_ms: float | None = 2.5) -> NeighbourState:
    return NeighbourState(
        name,
        "main",
        7,
        PlatformKind.UAV,
        state,
        "127.0.0.1:5",
        0,
        0.05,
        10.0,
        0.25,
        0.5,
        rtt_ms,
        256,
        0,
        0,
        0,
        ConnectionStatus.DATAGRAMS,
        True,
    )


def test_metrics_are_read_back_by_prometheus_parser() -> None:
    link = LinkTraffic(
        "uav2",
        LinkTransport.UDP,
        sent_bytes=1234,
        repeated_bytes=99,
        waiting_frames=3,
        capacity_bytes_s=60_000.0,
    )
    channel = ChannelTraffic("nav/pose", offered_frames=10, held_back=4, delivered_frames=6)
    outage = LinkOutage("uav3", "main", 9, 1, OutageCause.SILENT, OutagePhase.OVER, 1.1, 4.5, 0.2, 0.0)
    found = samples(
        metrics_page(
            "uav1",
            traffic(
                udp_sent_bytes=5000,
                refused=Refused(forged=2),
                links=(link,),
                channels=(channel,),
                slowdown=1.5,
            ),
            Neighbours((neighbour("uav2", LinkStatus.UP), neighbour("uav3", LinkStatus.DOWN))),
            OutageTable((msgspec.structs.replace(outage, phase=OutagePhase.LOST, down_for_s=None), outage)),
        )
    )
    assert read(found, "swarm_udp_sent_bytes_total") == 5000
    assert read(found, "swarm_refused_total", reason="forged") == 2
    assert read(found, "swarm_refused_total", reason="spoofed") == 0
    assert read(found, "swarm_link_sent_bytes_total", neighbour="uav2", transport="udp") == 1234
    assert read(found, "swarm_link_repeated_bytes_total", neighbour="uav2", transport="udp") == 99
    assert read(found, "swarm_link_waiting_frames", neighbour="uav2", transport="udp") == 3
    assert read(found, "swarm_link_capacity_bytes_per_second", neighbour="uav2", transport="udp") == 60_000
    assert read(found, "swarm_channel_offered_frames_total", channel="nav/pose") == 10
    assert read(found, "swarm_channel_held_back_total", channel="nav/pose") == 4
    assert read(found, "swarm_channel_delivered_frames_total", channel="nav/pose") == 6
    assert read(found, "swarm_link_up", neighbour="uav2") == 1
    assert read(found, "swarm_link_up", neighbour="uav3") == 0
    assert read(found, "swarm_link_round_trip_seconds", neighbour="uav2") == 0.0025
    assert read(found, "swarm_link_loss_in_ratio", neighbour="uav2") == 0.25
    assert read(found, "swarm_link_kept_outages", neighbour="uav3") == 2
    assert read(found, "swarm_link_last_outage_seconds", neighbour="uav3") == 4.5
    assert read(found, "swarm_beacon_slowdown_ratio") == 1.5


def test_each_counter_of_tables_is_on_page() -> None:
    page = metrics_page(
        "uav1",
        traffic(links=(LinkTraffic("uav2", LinkTransport.TCP),), channels=(ChannelTraffic("nav/pose"),)),
        Neighbours(),
        OutageTable(),
    )
    left_out = {"platform", "transport", "channel", "max_hz", "repeated_bytes"}
    left_out |= {"capacity_bytes_s", "capacity_ns"}  # only of links on which it was measured
    for prefix, table in (("swarm_link_", LinkTraffic), ("swarm_channel_", ChannelTraffic)):
        for field in msgspec.structs.fields(table):
            assert field.name in left_out or f"{prefix}{field.name}" in page, field.name


@settings(max_examples=30)
@given(st.text(max_size=40), st.text(max_size=40))
def test_any_name_is_label_that_is_read_back(channel: str, platform: str) -> None:
    page = metrics_page(
        "uav1",
        traffic(
            links=(LinkTraffic(platform, LinkTransport.UDP, lost=3),),
            channels=(ChannelTraffic(channel, dropped=5),),
        ),
        Neighbours(),
        OutageTable(),
    )
    found = samples(page)
    assert read(found, "swarm_channel_dropped_total", channel=channel) == 5
    assert read(found, "swarm_link_lost_total", neighbour=platform, transport="udp") == 3


def found(status: int, with_body: bool = True) -> HttpAnswer:
    return HttpAnswer(HTTPStatus(status), with_body)


def head(first: str, *fields: str) -> bytes:
    return "\r\n".join((first, *fields)).encode()


@pytest.mark.parametrize(
    ("request_head", "answer"),
    [
        (head("GET /metrics HTTP/1.1", "Host: uav1"), found(200)),
        (head("GET /metrics?x=1 HTTP/1.0"), found(200)),
        (head("HEAD /metrics HTTP/1.1"), found(200, with_body=False)),
        (head("GET / HTTP/1.1"), found(404)),
        (head("POST /metrics HTTP/1.1"), found(405)),
        (head("GET /metrics"), found(400)),
        (head("GET /metrics HTTP/1.1", "no colon"), found(400)),
        (b"\x16\x03\x01\x02\x00\x01", found(400)),
    ],
)
def test_only_a_request_for_the_page_gets_it(request_head: bytes, answer: HttpAnswer) -> None:
    assert judge(request_head, b"") == answer


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        ((), 401),
        (("Authorization: Bearer secret",), 200),
        (("authorization: bearer secret",), 200),
        (("Authorization: Bearer secrets",), 401),
        (("Authorization: Basic secret",), 401),
        (("Authorization: Bearer",), 401),
    ],
)
def test_token_bearer_alone_gets_page(fields: tuple[str, ...], status: int) -> None:
    assert judge(head("GET /metrics HTTP/1.1", *fields), b"secret").status == status
    if status == 401:
        assert judge(head("GET /other HTTP/1.1", *fields), b"secret").status == 401, (
            "nothing is told to others"
        )


@given(st.binary(max_size=300), st.booleans())
def test_any_bytes_get_an_answer(data: bytes, with_token: bool) -> None:
    assert judge(data, b"secret" if with_token else b"").status in {200, 400, 401, 404, 405}


def test_an_address_that_others_reach_needs_a_token() -> None:
    with pytest.raises(InvalidInput, match="metrics_token_file"):
        Config(metrics_port=9477, metrics_address="0.0.0.0")
    Config(metrics_port=9477, metrics_address="0.0.0.0", metrics_token_file="/etc/swarm/metrics.token")
    Config(metrics_address="0.0.0.0")
