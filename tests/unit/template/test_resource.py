"""The resource descriptor: what it fills in, and what it refuses."""

import math

import msgspec
import pytest

from swarmware.errors import InvalidInput
from swarmware.model.names import data_id
from swarmware.model.resource import Kind, Resource


@pytest.mark.parametrize(
    ("fields", "category", "link"),
    [
        ({"kind": Kind.BOARD, "type": "Pose", "rate_hz": 20.0}, "periodic", "tick"),
        ({"kind": Kind.BOARD, "type": "Pose"}, "conditional", "notify"),
        (
            {"kind": Kind.BOARD, "type": "Pose", "rate_hz": 1.0, "category": "conditional"},
            "conditional",
            "notify",
        ),
        ({"kind": Kind.BOARD, "type": "Pose", "rate_hz": 1.0, "link": "request"}, "periodic", "request"),
        ({"kind": Kind.EVENT, "type": "Fault"}, "conditional", "notify"),
        ({"kind": Kind.STREAM, "type": "Blob", "rate_hz": 753.0}, "periodic", "request"),
        ({"kind": Kind.COMMAND, "type": "Goal"}, "conditional", "request"),
        ({"kind": Kind.FILE, "type": "Blob"}, "conditional", "request"),
        ({"kind": Kind.SETTING, "type": "Float", "default": 1.0}, "conditional", "notify"),
        ({"kind": Kind.BRANCH}, "conditional", "request"),
    ],
)
def test_kind_and_rate_decide_how_a_value_travels(
    fields: dict[str, object], category: str, link: str
) -> None:
    resource = msgspec.convert({"path": "a/b"} | fields, Resource)
    assert (resource.category, resource.link) == (category, link)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"path": "Nav/pose", "type": "Pose"}, "segment 'Nav'"),
        ({"path": "/uav1/nav/pose", "type": "Pose"}, "local path"),
        ({"path": "nav/pose"}, "type of nav/pose: missing"),
        ({"path": "nav/pose", "type": "Pose", "log": "often"}, "expected 'all', 'none' or '<n>hz'"),
        ({"path": "nav/pose", "type": "Pose", "rate_hz": -1.0}, "rate_hz"),
        ({"path": "nav/pose", "type": "Pose", "rate_hz": math.inf}, "rate_hz"),
        ({"path": "nav/pose", "type": "Pose", "max_age_s": math.nan}, "max_age_s"),
        ({"path": "a", "type": "Float", "range": (2.0, 1.0)}, r"expected \[minimum, maximum\]"),
        ({"path": "a", "type": "Fault", "kind": Kind.EVENT, "link": "tick"}, "carries boards only"),
        ({"path": "a", "type": "Float", "kind": Kind.SETTING}, "expected the first value"),
        ({"path": "a", "type": "Float", "default": "fast"}, "expected Float"),
        ({"path": "a", "type": "Int", "default": True}, "expected Int"),
        ({"path": "a", "type": "Pose", "default": 1}, "only Float, Int, Bool, Text"),
        ({"path": "a", "type": "Float", "default": 9.0, "range": (0.0, 5.0)}, r"expected 0.0..5.0"),
        ({"path": "a", "type": "Text", "default": "x", "choices": ("y", "z")}, "one of y, z"),
    ],
)
def test_contradictions_are_refused_with_path_and_expectation(
    fields: dict[str, object], message: str
) -> None:
    with pytest.raises(InvalidInput, match=message):
        Resource(**fields)  # type: ignore[arg-type]


def test_contradictory_descriptor_from_wire_is_invalid() -> None:
    with pytest.raises(msgspec.ValidationError, match="type of a: missing"):
        msgspec.msgpack.decode(msgspec.msgpack.encode({"path": "a"}), type=Resource)


def test_a_descriptor_survives_messagepack_and_toml() -> None:
    resource = Resource(path="config/speed_m_s", kind=Kind.SETTING, type="Float", range=(0.0, 5.0), default=2)
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(resource), type=Resource) == resource
    assert msgspec.convert(msgspec.to_builtins(resource), Resource) == resource


def test_staleness_is_three_periods_unless_descriptor_says_otherwise() -> None:
    assert Resource(path="a", type="Pose", rate_hz=10.0).stale_after_s == pytest.approx(0.3)
    assert Resource(path="a", type="Pose", rate_hz=10.0, max_age_s=2.0).stale_after_s == 2.0
    assert Resource(path="a", type="Pose").stale_after_s == math.inf


def test_what_the_logger_keeps_is_a_rate() -> None:
    rates = [Resource(path="a", type="Pose", log=log).log_hz for log in ("none", "2.5hz", "all")]
    assert rates == [0.0, 2.5, math.inf]


def test_the_data_id_is_of_path_and_type() -> None:
    assert Resource(path="nav/pose", type="Pose").data_id == data_id("nav/pose", "Pose")


def test_non_number_is_in_no_range() -> None:
    assert not Resource(path="a", type="Float", range=(0.0, 1.0)).in_range(math.nan)
