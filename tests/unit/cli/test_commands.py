"""Commands without a swarm: each is a function of a session, and the answers of the swarm are given here."""

import io
import json
import re
from typing import Any

import click
import msgspec
import pytest
from tests.unit.cli.session import (
    GAIN,
    GET,
    LIST,
    SET,
    UNDO,
    ScriptedSession,
    listing,
    receipt,
    value,
)

from swarmctl.commands.app.listing import list_applications
from swarmctl.commands.config.changes import undo_setting
from swarmctl.commands.health.report import clear_faults, list_faults
from swarmctl.commands.mission.start import start
from swarmctl.commands.node.identity import show_node
from swarmctl.commands.topo.topology import show_topology
from swarmctl.commands.traffic.channels import set_channel
from swarmctl.commands.traffic.counters import list_counters
from swarmctl.commands.tree.listing import draw_resources, list_resources
from swarmctl.commands.tree.reading import print_values
from swarmctl.commands.tree.types import print_type
from swarmctl.resources.access import set_resource
from swarmctl.resources.listing import valued
from swarmware.errors import NoAnswer, NotFound, Partial
from swarmware.model.platform_kind import PlatformKind
from swarmware.model.resource import Kind
from swarmware.types import registry
from swarmware.types.channel import ChannelLimits, ChannelSettings, SetChannel
from swarmware.types.config import ConfigKey, ConfigOrigin, EffectiveConfig
from swarmware.types.description import FieldDescription, StructDescription, TypeDescription
from swarmware.types.health import FaultList
from swarmware.types.mission import LeftOut, MissionPlan, MissionTask, TaskAnswer
from swarmware.types.net import Neighbours, Routes
from swarmware.types.register import Register
from swarmware.types.system import NodeInfo
from swarmware.types.traffic import Traffic
from swarmware.types.tree import (
    Quality,
    TreeEntry,
    TreeListing,
    TreePlatform,
    TreeSetDone,
    TreeValue,
)
from swarmware.types.vehicle import Pose


@pytest.fixture(autouse=True)
def nobody_can_be_asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("SWARM_CONFIG", str(tmp_path))


async def test_applications_of_platform_without_register_are_not_found() -> None:
    session = ScriptedSession({"/uav1/sys/register/apps": Register()}, node="uav1")
    with pytest.raises(NotFound, match="register of uav1"):
        await list_applications(session)
    assert session.stdout.getvalue() == ""


async def test_node_is_shown_to_people_and_as_document() -> None:
    info = NodeInfo(
        "uav1", "main", PlatformKind.UAV, "multirotor", "0.1.0", 7, 61.0, ("broker",), "/etc/swarm", "one"
    )
    for output in ("table", "json"):
        session = ScriptedSession({"sys/node/info": info}, output=output, node="uav1")
        await show_node(session)
        if output == "json":
            assert session.document["uptime_s"] == 61.0
        else:
            assert "1m01s" in session.stdout.getvalue()


async def test_unmatched_faults_are_error_unless_all_meant() -> None:
    session = ScriptedSession({"sys/health/clear": FaultList("uav1", 1)})
    await clear_faults(session, "**", yes=True)
    with pytest.raises(NotFound, match="no fault matches age/x"):
        await clear_faults(session, "age/x", yes=True)


async def test_no_faults_are_talk_and_not_a_result() -> None:
    session = ScriptedSession({"sys/health/faults": FaultList("uav1", 1)})
    await list_faults(session, cleared=False)
    assert session.stdout.getvalue() == ""
    assert "--cleared" in session.stderr.getvalue()


async def test_topology_with_silent_platform_is_printed_and_partial() -> None:
    answers = {"/gcs/sys/broker/links": Neighbours(), "/uav1/sys/broker/links": NoAnswer("uav1: silent")}
    session = ScriptedSession(answers, output="json")
    with pytest.raises(Partial, match="1 of 2"):
        await show_topology(session, dot=False, png="")
    assert session.document["silent"] == ["uav1"]
    assert json.loads(session.stderr.getvalue())["warning"] == "uav1: silent"


async def test_value_prints_unit_and_lost_value_warning() -> None:
    path = "/uav1/height"
    session = ScriptedSession(
        {f"{GET} {path}": value(path, 1.5, quality=Quality.LOST, age_s=9.0)}, node="uav1"
    )
    await print_values(session, "height", fresh=False)
    assert session.stdout.getvalue() == "1.5 m\n"
    assert "Z, 9.000 s old, lost" in session.stderr.getvalue(), "time and age are no part of the value"
    assert "lost; this is the last value, 9 s old" in session.stderr.getvalue()


async def test_available_ones_of_several_values_are_printed() -> None:
    answers = {
        f"{LIST}": listing("/uav1/a", "/uav1/b"),
        f"{GET} /uav1/a": value("/uav1/a", 2.0),
        f"{GET} /uav1/b": NoAnswer("/uav1/b: no answer"),
    }
    session = ScriptedSession(answers)
    with pytest.raises(Partial, match="1 of 2 have no value"):
        await print_values(session, "/uav1/*", fresh=False)
    assert session.stdout.getvalue() == "/uav1/a  2 m  0.250 s old\n"


async def test_resources_are_listed_and_drawn() -> None:
    session = ScriptedSession({LIST: listing("/uav1/a", "/uav1/b/c")})
    await list_resources(session, "/uav1")
    await draw_resources(session, "/uav1")
    assert "/uav1/b/c  setting  Float" in session.stdout.getvalue()
    assert "    └── b\n        └── c  setting Float m" in session.stdout.getvalue()


async def test_list_has_ages_and_rates_of_owners() -> None:
    here = TreeListing(
        (TreeEntry("/uav1/a", Kind.BOARD, "Float"), TreeEntry("/uav1/b/c", Kind.BOARD, "Float")),
        platforms=(TreePlatform("uav1", True, 2, 1), TreePlatform("gcs", True, 2, 1)),
    )
    owner = TreeListing(
        (TreeEntry("/uav1/a", Kind.BOARD, "Float", age_s=0.04, quality=Quality.LIVE, measured_hz=19.98),)
    )
    answers = {LIST: here, "/uav1/sys/tree/list": owner}
    session = ScriptedSession(answers)
    await list_resources(session, "/uav1")
    out = session.stdout.getvalue()
    assert "/uav1/a    board  Float  20  0.0s  live" in out
    silent = ScriptedSession(answers | {"/uav1/sys/tree/list": NoAnswer("uav1: silent")}, output="json")
    await list_resources(silent, "/uav1")
    assert [entry["measured_hz"] for entry in silent.document["entries"]] == [None, None]
    assert "as seen from gcs" in silent.stderr.getvalue()


async def test_resource_known_to_its_platform_is_found() -> None:
    owner = "/uav1/sys/tree/list"
    answers = {LIST: TreeListing(()), owner: listing(GAIN, confirm="the vehicle may swing")}
    session = ScriptedSession(answers, node="uav1")
    assert [entry.path for entry in await valued(session, "config/gain")] == [GAIN]
    with pytest.raises(click.UsageError, match="the vehicle may swing"):
        await set_resource(session, "config/gain", "1.5", version=None, yes=False)
    unknown: dict[str, Any] = {
        LIST: TreeListing(()),
        owner: TreeListing(()),
        f"{GET} {GAIN}": value(GAIN, 1.0),
    }
    with pytest.raises(NotFound, match="no such resource"):
        await valued(ScriptedSession(unknown, node="uav1"), "config/gain")


async def test_type_is_shown_with_units_ranges_and_meaning() -> None:
    session = ScriptedSession({"/gcs/sys/broker/routes": Routes()}, output="table")
    await print_type(session, "BatteryState")
    assert "    current_a        float, A, " in session.stdout.getvalue()
    assert ": Positive: discharging." in session.stdout.getvalue()
    entry = TreeEntry(
        GAIN,
        Kind.SETTING,
        "Float",
        unit="1/s",
        access="rw",
        range=(0.0, 5.0),
        confirm="it may swing",
    )
    session = ScriptedSession({LIST: TreeListing((entry,))}, output="json")
    await print_type(session, GAIN)
    assert session.document["resource"]["confirm"] == "it may swing"
    field = session.document["types"][0]["fields"][0]
    assert (field["unit"], field["low"], field["high"]) == ("1/s", 0.0, 5.0)
    with pytest.raises(NotFound, match="no platform describes it"):
        await print_type(
            ScriptedSession(
                {
                    "/gcs/sys/tree/type /gcs/sys/tree/type": NotFound("no"),
                    "/gcs/sys/tree/type /uav1/sys/tree/type": NotFound("no"),
                }
            ),
            "Unknown",
        )


async def test_value_of_several_fields_has_line_each() -> None:
    path = "/uav1/nav/pose"
    pose = TreeValue(
        path, "Pose", registry.encode(Pose.planar(1.0, 2.0, yaw_rad=1.5707963)), 1, 1, 1, 0.25, Quality.LIVE,
        measured_hz=19.96,
    )  # fmt: skip
    session = ScriptedSession({f"{GET} {path}": pose}, node="uav1")
    await print_values(session, path, fresh=False)
    out = session.stdout.getvalue()
    assert re.match(r"/uav1/nav/pose: Pose, 20\d\d-.*Z, 0.250 s old, 20 Hz, live", out)
    assert "\n  x_m       1 m\n" in out
    assert out.endswith("  attitude  roll 0.0°, pitch 0.0°, yaw 90.0°\n")
    session = ScriptedSession({f"{GET} {path}": pose}, node="uav1", output="json")
    await print_values(session, path, names=("x_m", "y_m"), fresh=False)
    assert session.document["value"] == {"x_m": 1.0, "y_m": 2.0}
    session = ScriptedSession({f"{GET} {path}": pose}, node="uav1")
    await print_values(session, path, names=("x_m",), fresh=False)
    assert session.stdout.getvalue() == "1 m\n"
    session = ScriptedSession({f"{GET} {path}": pose}, node="uav1", output="json")
    await print_values(session, path, fresh=False)
    assert session.document["angles"][""]["yaw_deg"] == pytest.approx(90.0)


async def test_foreign_type_is_decoded_by_owners_description() -> None:
    path = "/uav1/sensor/rain"
    rain = TreeValue(path, "Rain", msgspec.msgpack.encode([1.5, "hail"]), 1, 1, 1, 0.25, Quality.LIVE)
    fields = (FieldDescription("fallen_m", "float"), FieldDescription("of", "str"))
    described = TypeDescription((StructDescription("Rain", fields, array=True),))
    answers: dict[str, Any] = {f"{GET} {path}": rain, "/gcs/sys/tree/type /uav1/sys/tree/type": described}
    session = ScriptedSession(answers, node="uav1", output="json")
    await print_values(session, path, fresh=False)
    assert session.document["value"] == {"fallen_m": 1.5, "of": "hail"}
    answers["/gcs/sys/tree/type /uav1/sys/tree/type"] = NotFound("type 'Rain'")
    session = ScriptedSession(answers, node="uav1", output="json")
    await print_values(session, path, fresh=False)
    assert session.document["value"] == [1.5, "hail"], "a list only if nobody describes it"


async def test_resource_that_wants_confirmation_is_not_set_without() -> None:
    answers = {
        LIST: listing(GAIN, confirm="the vehicle may swing"),
        f"{SET} {GAIN}": TreeSetDone(GAIN, 2, "Float", msgspec.msgpack.encode([1.5]), ("navigator",)),
    }
    session = ScriptedSession(answers, node="uav1")
    with pytest.raises(click.UsageError, match="the vehicle may swing"):
        await set_resource(session, "config/gain", "1.5", version=None, yes=False)
    assert SET not in session.asked
    await set_resource(session, "config/gain", "1.5", version=None, yes=True)
    assert session.stdout.getvalue() == f"{GAIN} = 1.5 (version 2, in force in navigator)\n"
    assert session.asked.count(LIST) == 1, "who has confirmed needs no question for the confirmation"


@pytest.mark.parametrize("verb", [SET, UNDO])
async def test_setting_refused_by_application_is_stored_and_error(
    verb: str,
) -> None:
    done = TreeSetDone(
        GAIN, 2, "Float", msgspec.msgpack.encode([1.5]), applied_by=("guidance",), awaited=("navigator",)
    )
    answers = {LIST: listing(GAIN), f"{GET} {GAIN}": value(GAIN, 4.0), f"{verb} {GAIN}": done}
    session = ScriptedSession(answers, node="uav1")
    with pytest.raises(NoAnswer, match="stored as version 2, but navigator has not taken it") as failed:
        if verb == SET:
            await set_resource(session, "config/gain", "1.5", version=None, yes=True)
        else:
            await undo_setting(session, "gain", yes=True)
    assert failed.value.exit_code == 4
    assert "(version 2, in force in guidance" in session.stdout.getvalue()


async def test_last_setting_change_is_undone_and_printed() -> None:
    answers = {
        LIST: listing(GAIN, confirm="the vehicle may swing"),
        f"{GET} {GAIN}": value(GAIN, 4.0),
        f"{UNDO} {GAIN}": TreeSetDone(GAIN, 2, "Float", msgspec.msgpack.encode([1.5])),
    }
    session = ScriptedSession(answers, node="uav1")
    with pytest.raises(click.UsageError, match="the vehicle may swing"):
        await undo_setting(session, "gain", yes=False)
    assert UNDO not in session.asked
    await undo_setting(session, "gain", yes=True)
    assert session.stdout.getvalue() == f"{GAIN} = 1.5 (version 2; was 4)\n"
    session = ScriptedSession(answers, node="uav1", output="json")
    await undo_setting(session, "gain", yes=True)
    document = session.document
    assert (document["path"], document["before"], document["value"], document["version"]) == (
        GAIN,
        4.0,
        1.5,
        2,
    )


async def test_unchanged_setting_cannot_be_undone() -> None:
    refused = NotFound(f"{GAIN}: was not changed; nothing to undo")
    data = msgspec.msgpack.encode(4.0)
    key = ConfigKey("gain", data, ConfigOrigin.DEFAULT, "float", "m", data, "", live=True)
    answers = {
        LIST: listing(GAIN),
        f"{GET} {GAIN}": value(GAIN, 4.0),
        f"{UNDO} {GAIN}": refused,
        "/uav1/sys/node/config": EffectiveConfig("uav1", (key,)),
    }
    session = ScriptedSession(answers, node="uav1")
    with pytest.raises(NotFound, match="nothing to undo"):
        await undo_setting(session, "gain", yes=False)
    assert session.stdout.getvalue() == ""


async def test_mission_is_not_started_before_operator_agrees() -> None:
    plan = MissionPlan("formation", "h", (), (LeftOut("uav2", "battery low"),), ("a parameter is unused",))
    session = ScriptedSession({"sys/mission/plan": plan})
    with pytest.raises(click.UsageError, match="without uav2: they will move"):
        await start(session, "formation", MissionTask("formation"), (), yes=False, watch=False)
    assert session.asked == ["sys/mission/plan"]
    assert "uav2: takes no part: battery low" in session.stderr.getvalue()
    assert "a parameter is unused" in session.stderr.getvalue()


async def test_mission_refused_by_platform_is_partial_and_named() -> None:
    orders = (receipt("uav1", accepted=True), receipt("uav2", accepted=False))
    answers = {
        "sys/mission/plan": MissionPlan("formation", "h", ()),
        "sys/mission/task": TaskAnswer("formation", "h", 1, False, orders),
    }
    session = ScriptedSession(answers)
    with pytest.raises(Partial, match="refused or not answered by uav2; not started"):
        await start(session, "formation", MissionTask("formation"), (), yes=True, watch=False)
    assert "uav2" in session.stdout.getvalue()


@pytest.mark.parametrize(
    ("pattern", "max_hz", "asks"),
    [
        ("**", 0.0, "are not sent"),
        ("nav/pose", 0.0, "are not sent"),
        ("**", 5.0, "barriers"),
        ("mission/*", 0.5, "barriers"),
        ("nav/*", 5.0, ""),
        ("**", None, ""),
    ],
)
async def test_limit_that_silences_vehicle_is_confirmed(
    pattern: str, max_hz: float | None, asks: str
) -> None:
    answers = {
        "/uav1/sys/broker/set_channel": ChannelLimits(),
    }
    session = ScriptedSession(answers, node="uav1")
    request = SetChannel(pattern, ChannelSettings(max_hz))
    if asks:
        with pytest.raises(click.UsageError, match=f"uav1: .*{asks}.*expected --yes"):
            await set_channel(session, request, yes=False)
        assert session.asked == []
    await set_channel(session, request, yes=bool(asks))
    assert "/uav1/sys/broker/set_channel" in session.asked


async def test_counters_of_refused_senders_have_name() -> None:
    links = [["uav2", "udp", 1, 90, 2, 180], ["?", "udp", 0, 0, 29, 3984]]
    found = msgspec.convert([0] * 16 + [1.0, [], links], Traffic)
    session = ScriptedSession({"sys/broker/traffic": found})
    await list_counters(session)
    lines = session.stdout.getvalue().splitlines()
    assert [line.split()[0] for line in lines if "udp" in line] == ["uav2", "unaccepted"]
