"""Two real nodes: the tree of the other appears, values go both ways, either side may start again."""

import asyncio
import contextlib
import signal
from pathlib import Path

import msgspec
import pytest
from tests.integration.tree.pair import SERVICES, on_uvloop, platforms, until
from tests.patience import PATIENCE_S, until_answer

from swarmware.errors import (
    Conflict,
    Denied,
    InvalidInput,
    NoAnswer,
    NotFound,
    OutOfRange,
    TypeMismatch,
)
from swarmware.model.resource import Kind, Resource
from swarmware.types.channel import ChannelLimits, ChannelSettings, SetChannel
from swarmware.types.description import TypeDescription
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.scalar import Blob, Float, Int, Text
from swarmware.types.tree import (
    Rule,
    TreeChange,
    TreeGet,
    TreeReset,
    TreeRule,
    TreeRules,
    TreeSet,
    TreeSetDone,
    TreeUndo,
    TreeValue,
    TypeRequest,
)
from swarmware.types.tree_exchange import StreamLosses
from swarmware.types.vehicle import Pose, VehicleState

SPEED = Resource(
    path="config/planner/speed_m_s",
    kind=Kind.SETTING,
    type="Float",
    unit="m/s",
    range=(0.0, 12.0),
    access="rw",
    default=2.5,
)
APART = (("broker", "register"), ("tree",))
LINE = {"uav1": ("uav2",), "uav2": ("uav1", "gcs"), "gcs": ("uav2",)}
"""Reception between the nodes, with two hops from uav1 to gcs."""


@on_uvloop
async def test_tree_of_neighbour_appears_with_its_modules(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        await gcs.until_listed("/uav1/net/routes", lambda entry: entry is not None)
        board = uav.probe.writer("plan/step", Text, description="what it is about to do")
        await gcs.until_listed("/uav1/plan/step", lambda entry: entry is not None and entry.owner == "probe")
        entry = (await gcs.list("/uav1/plan/*"))["/uav1/plan/step"]
        assert (entry.kind, entry.type, entry.description) == ("board", "Text", "what it is about to do")
        assert (await gcs.list("/*/plan/**")).keys() == {"/uav1/plan/step"}
        uav.probe.close_writer(board)


@on_uvloop
async def test_a_subscription_may_come_before_its_resource(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        fuel = gcs.probe.reader("/uav1/power/fuel", Float)
        faults = gcs.probe.stream_reader("/uav1/power/faults", Text)
        await gcs.until_listed("/uav1/net/routes", lambda entry: entry is not None)
        assert fuel.value is None
        board = uav.probe.writer("power/fuel", Float)
        board.write(Float(0.75))
        assert (await until(fuel, lambda value: True)).value == 0.75
        board.write(Float(0.5))
        await until(fuel, lambda value: value.value == 0.5)
        entry = (await gcs.list("/uav1/power/fuel"))["/uav1/power/fuel"]
        assert entry.quality == "live"
        # events: each of them, in order, once
        event = uav.probe.stream_writer("power/faults", Text, kind="event")
        await gcs.until_listed("/uav1/power/faults", lambda entry: entry is not None)
        event.write(Text("first"))
        heard = [(await faults.next(PATIENCE_S)).value]
        for number in range(100):
            event.write(Text(f"{number}"))
        while len(heard) < 101:
            heard.append((await faults.next(PATIENCE_S)).value)
        assert heard == ["first", *(f"{number}" for number in range(100))]


@on_uvloop
async def test_lost_stream_values_are_counted_at_both_ends(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        scans = gcs.probe.stream_reader("/uav1/sensor/scan", Blob)
        scan = uav.probe.stream_writer("sensor/scan", Blob, link="notify")
        got = 0
        async with asyncio.timeout(PATIENCE_S):
            while not got:
                scan.write(Blob(bytes(1000)))
                await asyncio.sleep(0.1)
                while scans.take() is not None:
                    got += 1
            first = scans.meta.sequence - got + 1 if scans.meta is not None else 0
            # more than its queue, and faster than anybody can take them
            for _ in range(6000):
                scan.write(Blob(bytes(1000)))
            last = scan.sequence
            while scans.meta is None or scans.meta.sequence < last:
                await scans.next()
                got += 1
            assert scans.lost > 0
            assert got + scans.lost == last - first + 1
        told = uav.probe.reader("tree/losses", StreamLosses)
        # the reader's own ring may have overrun too: that is not for the writer to know
        await until(told, lambda _: 0 < scan.losses.get("gcs", 0) <= scans.lost)
        assert scan.lost == scan.losses["gcs"]


@on_uvloop
async def test_periodic_board_rides_in_beacon_and_is_mirrored(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        poses = gcs.probe.readers("/*/nav/pose", Pose)
        pose = uav.probe.writer("nav/pose", Pose, rate_hz=10.0)
        async with asyncio.timeout(PATIENCE_S):
            count = 0
            while not (poses.keys() and poses["uav1"].value is not None):
                count += 1
                pose.write(Pose(float(count), 0.0))
                await asyncio.sleep(0.1)
        assert (await gcs.get("/uav1/nav/pose")).type == "Pose"


@on_uvloop
async def test_remote_values_come_from_mirror_or_owner(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        board = uav.probe.writer("plan/step", Text, unit="")
        board.write(Text("turn left"))
        await gcs.until_listed("/uav1/plan/step", lambda entry: entry is not None)
        asked = await gcs.get("/uav1/plan/step")
        assert (asked.source, asked.path, asked.type) == ("own", "/uav1/plan/step", "Text")
        assert msgspec.msgpack.decode(asked.data, type=Text) == Text("turn left")
        mirror = gcs.probe.reader("/uav1/plan/step", Text)
        await until(mirror, lambda value: value.value == "turn left")
        assert (await gcs.get("/uav1/plan/step")).source == "mirror"
        assert (await gcs.get("/uav1/plan/step", fresh=True)).source == "own"
        assert (await uav.get("plan/step")).source == "own"
        with pytest.raises(NotFound, match="did you mean /uav1/plan/step"):
            await gcs.get("/uav1/plan/stop")
        with pytest.raises(NotFound, match=r"'uav7': not known to gcs; expected one of gcs, uav1"):
            await gcs.probe.request(
                "sys/tree/get", TreeGet("/uav7/plan/step"), TreeValue, timeout_s=PATIENCE_S
            )
        with pytest.raises(NotFound, match="a branch has no value"):
            await gcs.get("/uav1/net")
        with pytest.raises(NotFound, match="no value yet"):
            await gcs.get("/uav1/mission/state")


@on_uvloop
async def test_node_sets_nothing_elsewhere_and_audit_names_it(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        gcs.probe.provide(SPEED)
        changes = gcs.probe.stream_reader("tree/changes", TreeChange)
        path = f"/gcs/{SPEED.path}"
        await uav.until_listed(path, lambda entry: entry is not None)
        with pytest.raises(Denied, match=rf"{SPEED.path}: node@uav1 may not set it; expected role operator"):
            await uav.set(path, 4.0)
        refused = await changes.next(PATIENCE_S)
        assert (refused.path, refused.by, refused.after) == (path, "node@uav1", "")
        await gcs.set(path, 3.0)
        assert (await changes.next(PATIENCE_S)).by == "probe#1@gcs"
        # neither a third platform nor an application of the node gets the rights of the node
        path = "/uav1/speed"
        around: list[tuple[str, msgspec.Struct, type[msgspec.Struct]]] = [
            ("set", TreeSet(path, b"\x01"), TreeSetDone),
            ("undo", TreeUndo(path), TreeSetDone),
            ("reset", TreeReset(path), TreeSetDone),
            ("get", TreeGet(path, True), TreeValue),
        ]
        for verb, request, reply in around:
            expected = rf"asked of gcs; expected a request to its owner, /uav1/sys/tree/{verb}"
            for one in (uav, gcs):
                with pytest.raises(Denied, match=expected):
                    await one.probe.request(f"/gcs/sys/tree/{verb}", request, reply, timeout_s=PATIENCE_S)
        with pytest.raises(Denied, match="asked of gcs"):
            await uav.probe.request("/gcs/sys/tree/get", TreeGet(path), TreeValue, timeout_s=PATIENCE_S)
        with pytest.raises(Denied, match="asked of gcs"):
            await uav.probe.request(
                "/gcs/sys/tree/type", TypeRequest("Text", "uav1"), TypeDescription, timeout_s=5
            )


@on_uvloop
async def test_settings_are_checked_kept_versioned_and_undone(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        uav.probe.provide(SPEED)
        own = uav.probe.reader(SPEED.path, Float)
        changes = uav.probe.stream_reader("tree/changes", TreeChange)
        assert (await until(own, lambda value: True)).value == 2.5
        path = f"/uav1/{SPEED.path}"
        await gcs.until_listed(path, lambda entry: entry is not None)
        seen = gcs.probe.reader(path, Float)
        done = await gcs.set(path, 4)
        assert (done.path, done.version) == (path, 1)
        await until(own, lambda value: value.value == 4.0)
        await until(seen, lambda value: value.value == 4.0)
        change = await changes.next(PATIENCE_S)
        assert (change.path, change.by, change.before, change.after) == (
            path,
            "maintainer@gcs",
            "[2.5]",
            "[4.0]",
        )
        assert (await gcs.get(path, fresh=True)).version == 1
        with pytest.raises(Conflict, match=r"has version 1 \(4\.0\) now; expected 0"):
            await gcs.set(path, 5, version=0)
        with pytest.raises(OutOfRange, match=r"13 m/s; expected 0 to 12 m/s"):
            await gcs.set(path, 13)
        with pytest.raises(TypeMismatch, match="expected `float`, got `str`"):
            await gcs.set(path, "fast")
        with pytest.raises(Denied, match="access r"):
            await gcs.set("/uav1/net/routes", 1)
        with pytest.raises(InvalidInput, match=r"an? event cannot be set"):
            await gcs.set("/uav1/tree/changes", 1)
        with pytest.raises(NotFound, match="no such resource"):
            await gcs.set("/uav1/config/planner/spede", 1)
        assert own.value == Float(4.0)
        # kept over a restart
        await uav.end("broker", "tree", "register")
        await uav.start("broker", "tree", "register")
        value = await until_answer(lambda: gcs.get(path, fresh=True))
        assert (value.version, msgspec.msgpack.decode(value.data)) == (1, [4.0])
        back = await gcs.probe.request(
            "/uav1/sys/tree/undo", TreeUndo(path), TreeSetDone, timeout_s=PATIENCE_S
        )
        assert (back.version, msgspec.msgpack.decode(back.data)) == (2, [2.5])
        await until(seen, lambda value: value.value == 2.5)


@on_uvloop
async def test_command_reaches_its_application_and_board(
    tmp_path: Path,
) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        inbox = uav.probe.inbox("cmd/goto", Goal)
        uav.probe.serve("sys/double", Int, lambda request, _: Int(request.value * 2), reply=Int)
        await gcs.until_listed("/uav1/sys/double", lambda entry: entry is not None)
        await gcs.set("/uav1/cmd/goto", {"seq": 3, "kind": "goto", "x_m": 5})
        assert (await inbox.next(PATIENCE_S)) == Goal(3, GoalKind.GOTO, 5.0)
        with pytest.raises(TypeMismatch, match="no field 'colour' in Goal"):
            await gcs.set("/uav1/cmd/goto", {"seq": 3, "kind": "goto", "colour": 5})
        with pytest.raises(TypeMismatch, match="field 'kind' of Goal is missing"):
            await gcs.set("/uav1/cmd/goto", {"seq": 3})
        done = await gcs.set("/uav1/sys/double", 21)
        assert (done.type, msgspec.msgpack.decode(done.data)) == ("Int", [42])


@pytest.mark.parametrize("side", [0, 1], ids=["owner", "subscriber"])
@on_uvloop
async def test_killed_tree_service_heals_from_either_side(tmp_path: Path, side: int) -> None:
    async with platforms(tmp_path, "uav1", "gcs", services=(APART[0],)) as both:
        uav, gcs = both
        trees = [await platform.start("tree") for platform in both]
        fuel = gcs.probe.reader("/uav1/power/fuel", Float)
        faults = gcs.probe.stream_reader("/uav1/power/faults", Text)
        board = uav.probe.writer("power/fuel", Float)
        event = uav.probe.stream_writer("power/faults", Text, kind="event")
        board.write(Float(0.9))
        await until(fuel, lambda value: value.value == 0.9)
        event.write(Text("before"))
        assert (await faults.next(PATIENCE_S)).value == "before"
        later = gcs.probe.reader("/uav1/plan/later", Text)
        rule = TreeRule("power/*", min_interval_s=0.05)
        set_rules = await gcs.probe.request("/uav1/sys/tree/rule", rule, TreeRules, timeout_s=PATIENCE_S)
        trees[side].signal(signal.SIGKILL)
        await trees[side].wait()
        board.write(Float(0.8))
        # of a resource that did not exist when it was subscribed to, and comes while one of the trees is dead
        uav.probe.writer("plan/later", Text).write(Text("it came"))
        await both[side].start("tree")
        await until(fuel, lambda value: value.value == 0.8)
        await until(later, lambda value: value.value == "it came")
        kept = await uav.probe.request("sys/tree/rule", TreeRule("**"), TreeRules, timeout_s=PATIENCE_S)
        assert kept == set_rules
        assert kept.rules == (Rule("power/*", 0.0, 0.05),)
        event.write(Text("after"))
        # an event that nobody watched is lost with the service that should have; none comes twice
        assert (await faults.next(PATIENCE_S)).value == "after"
        assert faults.take() is None


@on_uvloop
async def test_killed_application_is_lost_at_every_neighbour(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs", tree={"lost_s": 0.3, "expire_s": 0.5}) as (uav, gcs):
        timesync = await uav.start("timesync")
        there = "/uav1/app/timesync/status"
        await gcs.until_listed(there, lambda entry: entry is not None and entry.quality != "lost")
        timesync.signal(signal.SIGKILL)
        await timesync.wait()
        await gcs.until_listed(there, lambda entry: entry is not None and entry.quality == "lost")
        # the template names it: it is expected again, as if it had never run
        await gcs.until_listed(there, lambda entry: entry is not None and entry.quality == "none")


@on_uvloop
async def test_stream_arrives_whole_over_two_hops(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "uav2", "gcs", hear=LINE) as (uav, _, gcs):
        scans = gcs.probe.stream_reader("/uav1/sensor/scan", Blob)
        scan = uav.probe.stream_writer("sensor/scan", Blob, link="notify")
        async with asyncio.timeout(PATIENCE_S):
            while scans.take() is None:  # a stream begins where its subscription does
                scan.write(Blob(b""))
                await asyncio.sleep(0.1)
            for number in range(200):
                scan.write(Blob(number.to_bytes(2, "big") * 500))
            taken: list[bytes] = []
            while len(taken) < 200:
                if data := (await scans.next()).value:
                    taken.append(data)
        assert taken == [number.to_bytes(2, "big") * 500 for number in range(200)]
        assert (scans.lost, scan.losses) == (0, {})


@on_uvloop
async def test_distant_reader_gets_state_after_gap(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "uav2", "gcs", hear=LINE) as (uav, _, gcs):
        written: list[int] = []
        deltas = uav.probe.stream_writer("map/delta", Int, link="notify", slots=8)
        uav.probe.serve_snapshots(deltas, lambda: Text(str(sum(written))))

        def write(*values: int) -> None:
            for value in values:
                written.append(value)
                deltas.write(Int(value))

        stream = gcs.probe.snapshot_stream("/uav1/map/delta", Int, Text)
        total = 0

        async def follow(timeout_s: float | None = None) -> None:
            """Adds what comes until it has the state of the owner."""
            nonlocal total
            while total != sum(written):
                found = await stream.next(timeout_s)
                total = int(found.value) if isinstance(found, Text) else total + found.value

        async with asyncio.timeout(PATIENCE_S):
            write(100)
            await follow()
            while not stream.lost:  # a subscription begins some time after the first snapshot
                write(*range(1, 40))  # at once: more than the ring keeps, so the tree misses the first ones
                await asyncio.sleep(0.1)
                write(7)
                with contextlib.suppress(NoAnswer):
                    await follow(0.5)
            await follow()
        assert stream.resyncs >= 2
        assert total == sum(written)


@on_uvloop
async def test_platform_two_hops_away_is_met_and_set(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "uav2", "gcs", hear=LINE) as (uav, _, gcs):
        board = uav.probe.writer("plan/step", Text)
        board.write(Text("turn left"))
        uav.probe.provide(SPEED)
        # nobody on gcs reads anything of it: its structure is asked for when somebody looks
        await gcs.until_listed("/uav1/plan/step", lambda entry: entry is not None)
        mirror = gcs.probe.reader("/uav1/plan/step", Text)
        await until(mirror, lambda value: value.value == "turn left")
        changes = uav.probe.stream_reader("tree/changes", TreeChange)
        assert (await gcs.set(f"/uav1/{SPEED.path}", 3.5)).version == 1
        change = await changes.next(PATIENCE_S)
        assert (change.by, change.via) == ("maintainer@gcs", ("uav2",))
        assert (await gcs.get(f"/uav1/{SPEED.path}")).source == "own"


@on_uvloop
async def test_last_value_of_killed_platform_stays_readable(tmp_path: Path) -> None:
    keep = {"keep": ["nav/pose", "vehicle/state"]}
    async with platforms(tmp_path, "uav1", "gcs", tree=keep, start=False) as (uav, gcs):
        process = await uav.start(*SERVICES)
        await gcs.start(*SERVICES)
        pose = uav.probe.writer("nav/pose", Pose, rate_hz=10.0)
        state = uav.probe.writer("vehicle/state", VehicleState, link="notify")
        state.write(VehicleState(True, False))
        async with asyncio.timeout(PATIENCE_S):
            quality, number = "", 0
            while quality not in {"live", "stale"}:  # no timesync runs here: its clock is not known
                number += 1
                pose.write(Pose(float(number), 0.0))
                await asyncio.sleep(0.1)
                found = await gcs.list("/uav1/nav/pose")
                quality = found["/uav1/nav/pose"].quality if found else ""
        await gcs.until_listed(
            "/uav1/vehicle/state", lambda entry: entry is not None and entry.quality == "live"
        )
        process.signal(signal.SIGKILL)
        await process.wait()
        await gcs.until_listed("/uav1/nav/pose", lambda entry: entry is not None and entry.quality == "lost")
        last = await gcs.get("/uav1/nav/pose")
        assert (last.quality, last.source) == ("lost", "mirror")
        assert 0 < msgspec.msgpack.decode(last.data, type=Pose).x_m <= number
        assert last.age_s is not None, "no clock is known, but how long it has been silent"
        assert last.age_s > 0
        told = msgspec.msgpack.decode((await gcs.get("/uav1/vehicle/state")).data, type=VehicleState)
        assert told.armed
        with pytest.raises(NoAnswer, match="uav1 cannot be reached"):
            await gcs.get("/uav1/net/traffic")


@on_uvloop
async def test_broker_limit_covers_notifications_but_refuses_commands(
    tmp_path: Path,
) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        fuel = gcs.probe.reader("/uav1/power/fuel", Float)
        board = uav.probe.writer("power/fuel", Float)
        board.write(Float(0.9))
        await until(fuel, lambda value: value.value == 0.9)

        async def limit(pattern: str, max_hz: float | None) -> ChannelLimits:
            there = "/uav1/sys/broker/set_channel"
            return await gcs.probe.request(
                there, SetChannel(pattern, ChannelSettings(max_hz)), ChannelLimits, timeout_s=PATIENCE_S
            )

        with pytest.raises(InvalidInput, match=r"sys/tree/get \(each message is delivered\)"):
            await limit("sys/tree/get", 1.0)
        stopped = uav.probe.reader("net/limits", ChannelLimits)
        await limit("**", 0.0)
        await until(stopped, lambda limits: [one.settings.max_hz for one in limits.limits] == [0.0])
        board.write(Float(0.85))
        with contextlib.suppress(NoAnswer):
            await fuel.changed(1.0)  # the tree may read the limit a turn of the loop after this test has
        board.write(Float(0.8))
        with pytest.raises(NoAnswer):
            await fuel.changed(1.0)
        await limit("**", None)
        await until(fuel, lambda value: value.value == 0.8)
