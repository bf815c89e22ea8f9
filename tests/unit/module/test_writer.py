"""What a writer publishes is described by a few keywords, or by a whole descriptor."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from swarmware.errors import Conflict, InvalidInput, SwarmError, TypeMismatch
from swarmware.model.resource import Kind, Resource
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.scalar import Float, Int

HEAT = Resource(path="motor/heat", type="Float", rate_hz=10.0, critical=True, max_age_s=0.5, access="rw")
LIMIT = Resource(path="config/limit", kind=Kind.SETTING, type="Float", default=1.0, range=(0.0, 2.0))
TRIP = Resource(path="motor/trip", kind=Kind.EVENT, type="Int", link="request", log="all")


async def test_keywords_and_a_descriptor_say_the_same(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as m:
        details: dict[str, Any] = {
            "unit": "m",
            "rate_hz": 5.0,
            "log": "1hz",
            "link": "notify",
            "description": "?",
        }
        by_path = m.writer("nav/height", Float, **details)
        stated = Resource(path="nav/depth", type="Float", **details)
        by_resource = m.writer(stated, Float)
        same = msgspec.structs.replace(by_path.resource, path="nav/depth")
        assert by_resource.resource == same
        assert same.owner == "motor"
        steps = m.stream_writer("plan/steps", Int, kind="event", log="all", link="request")
        assert steps.resource == Resource(
            path="plan/steps", kind=Kind.EVENT, type="Int", log="all", link="request", owner="motor"
        )
        assert steps.resource.kind is Kind.EVENT


async def test_a_descriptor_states_what_keywords_do_not(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as m:
        heat, limit, trip = m.writer(HEAT, Float), m.writer(LIMIT, Float), m.stream_writer(TRIP, Int, slots=4)
        values = m.reader("motor/heat", Float), m.reader("config/limit", Float)
        items = m.stream_reader("motor/trip", Int, from_oldest=True)
        heat.write(Float(3.0))
        limit.write(Float(1.5))
        for number in range(9):
            trip.write(Int(number))
        assert [reader.value for reader in values] == [Float(3.0), Float(1.5)]
        first = items.take()
        assert first is not None
        assert 9 - 4 <= first.value == items.lost < 9, "no more than four slots"
        assert [one.resource for one in (heat, limit, trip)] == [
            msgspec.structs.replace(one, owner="motor") for one in (HEAT, LIMIT, TRIP)
        ]


MISTAKES: list[tuple[str, str | Resource, dict[str, Any], type[SwarmError], str]] = [
    ("writer", TRIP, {}, InvalidInput, "motor/trip: of kind event; expected board or setting"),
    ("writer", "motor/trip", {"kind": "event"}, InvalidInput, "of kind event; expected board or setting"),
    ("stream_writer", HEAT, {}, InvalidInput, "motor/heat: of kind board; expected stream or event"),
    (
        "stream_writer",
        "motor/trip",
        {"kind": "often"},
        InvalidInput,
        "of kind often; expected stream or event",
    ),
    ("writer", HEAT, {"rate_hz": 5.0}, InvalidInput, "motor/heat: rate_hz: expected inside the descriptor"),
    ("writer", LIMIT, {}, TypeMismatch, "config/limit: Int; its descriptor expects Float"),
    ("writer", "nav/height", {"log": "often"}, InvalidInput, "log of nav/height: 'often', expected 'all'"),
    ("writer", "nav/height", {"rate_hz": -1.0}, InvalidInput, "rate_hz of nav/height: -1.0, expected 0 or"),
    ("stream_writer", "plan/a", {"link": "tick"}, InvalidInput, "'tick' carries boards only, not a stream"),
    ("writer", "/uav7/nav/height", {}, InvalidInput, "of another platform; expected a resource of uav1"),
    ("writer", "nav//height", {}, InvalidInput, "nav//height"),
]


@pytest.mark.parametrize(("method", "resource", "details", "error", "message"), MISTAKES)
async def test_unwritable_value_is_refused_with_path(
    tmp_path: Path,
    method: str,
    resource: str | Resource,
    details: dict[str, Any],
    error: type[SwarmError],
    message: str,
) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as m:
        with pytest.raises(error, match=message):
            getattr(m, method)(resource, Int, **details)
        assert not list(node.shm_dir.glob("*.ring")), "nothing is made for it"


async def test_a_resource_has_one_writer(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as m, Module("other", node=node) as n:
        m.writer(HEAT, Float)
        with pytest.raises(Conflict, match=r"motor\.heat"):
            n.writer("motor/heat", Float)


@pytest.mark.parametrize("use", ["node", "clock", "id", "entry", "platform", "app_id", "instance"])
def test_module_off_node_says_what_is_expected(use: str) -> None:
    with pytest.raises(InvalidInput, match="module planner: not on a node; expected use inside `async with`"):
        getattr(Module("planner"), use)
