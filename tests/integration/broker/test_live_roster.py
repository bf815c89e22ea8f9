"""The roster while brokers run: revocation and rotation without a restart and without a gap, on the wire."""

import asyncio
import logging
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.integration.broker.hostile import PATH, TRIES, dealer, found_by_doctor, order
from tests.integration.broker.swarm import Station, on_uvloop, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmctl.commands.doctor.checks import examine
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, Header
from swarmware.errors import Conflict, Denied
from swarmware.model.frame import encode
from swarmware.model.names import hardware_id
from swarmware.module.board import BoardReader
from swarmware.transport.security.keys import Keys, read_roster
from swarmware.transport.security.root import Root, candidate, make_swarm
from swarmware.transport.security.seal import Sealer
from swarmware.types.net import RosterState, SignedRoster
from swarmware.types.scalar import Float, Text

NAMES = ("uav1", "uav2", "uav3")
Boards = dict[str, BoardReader[RosterState]]


@asynccontextmanager
async def members(
    root: Path,
) -> AsyncIterator[tuple[Root, dict[str, Station], dict[str, BoardReader[RosterState]]]]:
    async with swarm(root, *NAMES) as stations:
        for name, station in stations.items():
            await station.until_up(*(other for other in NAMES if other != name))
        boards = {name: station.app.reader("net/roster", RosterState) for name, station in stations.items()}
        yield Root.load(root / "keys"), stations, boards


async def hand_over(station: Station, text: bytes) -> RosterState:
    return await station.app.request(
        "sys/broker/roster", SignedRoster(text), RosterState, timeout_s=PATIENCE_S
    )


async def until_has(board: BoardReader[RosterState], version: int) -> RosterState:
    async with asyncio.timeout(PATIENCE_S):
        while (state := board.value) is None or state.version < version:
            await board.changed()
    return state


@on_uvloop
async def test_a_rotation_loses_no_message_and_no_beacon(tmp_path: Path) -> None:
    async with members(tmp_path) as (root, stations, boards):
        one, other = stations["uav1"], stations["uav2"]
        one.plan(offers=[("app/count", Float)])
        count = one.app.writer("app/count", Float, link="tick", rate_hz=10)
        other.plan(wants=[("uav1", "app/count", Float)])
        mirror = other.app.reader("/uav1/app/count", Float)
        box = other.app.inbox("cmd/note", Text)
        received = list[str]()
        changes = list[str]()
        sending = True

        async def write() -> None:
            value = 0
            while sending:
                value += 1
                count.write(Float(float(value)))
                await asyncio.sleep(0.05)

        async def read() -> None:
            async for note in box:
                received.append(note.value)

        async def watch() -> None:
            while True:
                await one.neighbours.changed()
                if (state := one.states().get("uav2")) != "up":
                    changes.append(str(state))

        tasks = [asyncio.create_task(each()) for each in (write, read, watch)]
        try:
            async with asyncio.timeout(PATIENCE_S):
                while mirror.value is None:
                    await mirror.changed()
            sent = 0
            for epoch in (1, 2):
                await hand_over(one, root.rotate())
                for board in boards.values():
                    assert (await until_has(board, 1 + epoch)).key_epoch == epoch
                for _ in range(40):
                    sent += 1
                    outcome = await one.app.send("/uav2/cmd/note", Text(str(sent)), timeout_s=PATIENCE_S)
                    assert outcome.delivered, outcome
                    await mirror.changed(timeout_s=2.0)
            assert received == [str(number) for number in range(1, sent + 1)]
            assert changes == [], "the link stayed up"
        finally:
            sending = False
            for task in tasks[1:]:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        for name in NAMES:
            traffic = await stations[name].traffic()
            assert traffic.refused.other_epoch == 0
            assert traffic.refused.forged == 0
            assert Keys.load(tmp_path / "keys" / name, name).group.epoch == 2


@on_uvloop
async def test_revoked_member_is_refused_everywhere_and_knows_it(tmp_path: Path) -> None:
    async with members(tmp_path) as (root, stations, boards):
        one, other, revoked = (stations[name] for name in NAMES)
        box, other_box = one.app.inbox("cmd/note", Text), other.app.inbox("cmd/note", Text)
        assert (await revoked.app.send("/uav1/cmd/note", Text("before"), timeout_s=PATIENCE_S)).delivered
        await hand_over(other, root.revoke("uav3"))
        for name in ("uav1", "uav2"):
            state = await until_has(boards[name], 2)
            assert [member.platform for member in state.members if member.revoked] == ["uav3"]
            assert not state.revoked_self
        assert (await until_has(boards["uav3"], 2)).revoked_self
        await revoked.until(
            lambda: revoked.conditions().get("broker/membership") == "revoked", revoked.checks
        )
        assert not (await revoked.app.send("/uav1/cmd/note", Text("after"), timeout_s=1.0)).delivered
        for station in (one, other):
            await station.until_counted(lambda traffic: traffic.refused.revoked > 0)
            await station.until_lost("uav3")
            assert "uav3" not in station.states() or station.states()["uav3"] == "down"
        assert (await one.app.send("/uav2/cmd/note", Text("among us"), timeout_s=PATIENCE_S)).delivered
        assert (await anext(other_box)).value == "among us"
        assert (await anext(box)).value == "before"
        assert len(box) == 0
        with pytest.raises(Denied, match="uav3 was revoked"):
            Keys.load(tmp_path / "keys" / "uav3", "uav3")


@on_uvloop
async def test_absent_member_learns_its_revocation_at_return(
    tmp_path: Path,
) -> None:
    async with members(tmp_path) as (root, stations, boards):
        one, away = stations["uav1"], stations["uav3"]
        box = one.app.inbox(PATH, Text)
        await away.stop()
        await hand_over(one, root.revoke("uav3"))
        await until_has(boards["uav2"], 2)
        await away.start()
        assert (await until_has(away.app.reader("net/roster", RosterState), 2)).revoked_self
        await away.until(lambda: away.conditions().get("broker/membership") == "revoked", away.checks)
        assert not (await away.app.send("/uav1/" + PATH, Text("back"), timeout_s=1.0)).delivered
        await one.until_counted(lambda traffic: traffic.refused.revoked > 0)
        assert "uav3" not in one.ways()
        assert len(box) == 0
        told = await asyncio.to_thread(examine, {"uav3": away.config_dir}, fix=False)
        [keys] = [result for result in told if result.check == "keys" and result.verdict == "error"]
        assert "uav3 was revoked" in keys.text
        assert "swarmctl keys join --replace" in keys.advice


@on_uvloop
async def test_doctor_names_key_replaced_during_absence(
    tmp_path: Path,
) -> None:
    async with members(tmp_path) as (root, stations, boards):
        one, away = stations["uav1"], stations["uav3"]
        await away.stop()
        # another computer has joined in its name, or its card was restored from a backup
        await hand_over(one, root.admit(candidate("uav3", "node", b"\4" * 32, root.public)))
        await until_has(boards["uav2"], 2)
        await away.start()
        assert (await until_has(away.app.reader("net/roster", RosterState), 2)).revoked_self
        await away.until(lambda: away.conditions().get("broker/membership") == "revoked", away.checks)
        assert "roster 2 has another key for uav3: these keys were replaced" in str(away.checks.value)
        told = await asyncio.to_thread(examine, {"uav3": away.config_dir}, fix=False)
        [keys] = [result for result in told if result.check == "keys" and result.verdict == "error"]
        assert "swarmctl keys join --replace" in keys.advice
        assert "uav3" not in one.ways()


@on_uvloop
async def test_node_that_was_away_during_rotations_catches_up(tmp_path: Path) -> None:
    async with members(tmp_path) as (root, stations, boards):
        late = stations["uav3"]
        await late.stop()
        for _ in range(3):
            await hand_over(stations["uav1"], root.rotate())
        await until_has(boards["uav2"], 4)
        await late.start()
        await until_has(late.app.reader("net/roster", RosterState), 4)
        await late.until_up("uav1", "uav2")
        outcome = await late.app.send("/uav1/cmd/note", Text("back"), timeout_s=1.0)
        assert outcome.where or outcome.delivered
        assert Keys.load(tmp_path / "keys" / "uav3", "uav3").group.epoch == 3


@on_uvloop
async def test_new_member_is_taken_while_others_run(tmp_path: Path) -> None:
    async with members(tmp_path) as (root, stations, boards):
        text = root.admit(candidate("uav4", "node", b"\4" * 32, root.public))
        await hand_over(stations["uav1"], text)
        for board in boards.values():
            state = await until_has(board, 2)
            assert [member.platform for member in state.members] == [*NAMES, "uav4"]


@on_uvloop
async def test_forged_or_old_roster_is_refused_with_reason(tmp_path: Path) -> None:
    async with members(tmp_path) as (root, stations, _):
        one, older = stations["uav1"], root.signed
        await hand_over(one, root.rotate())
        with pytest.raises(Conflict, match="roster 1 is older than 2"):
            await hand_over(one, older)
        stranger = Root.make(tmp_path / "stranger")
        with pytest.raises(Denied, match="not signed by this swarm's root"):
            await hand_over(one, stranger.rotate())
        assert (await hand_over(one, b"")).version == 2
        stored = read_roster(tmp_path / "keys" / "uav1" / "roster.json", root.public)
        assert stored.version == 2


@on_uvloop
async def test_nothing_that_a_revoked_member_sends_is_taken(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    port, udp = free_port(), free_port()
    make_swarm(tmp_path / "keys", dict.fromkeys(NAMES, "operator"))
    settings = {"uav1": {"tcp_port": port, "unicast_port": udp}}
    async with swarm(tmp_path, *NAMES, keys=False, settings=settings) as pair:
        one, root = pair["uav1"], Root.load(tmp_path / "keys")
        await pair["uav2"].until_up("uav1")
        await one.until_up("uav2", "uav3")  # from here on the test sends with the keys of uav3
        await pair["uav3"].stop()
        keys = Keys.load(tmp_path / "keys" / "uav3", "uav3")
        server = keys.curve_of("uav1")
        assert server is not None
        box = one.app.inbox(PATH, Text)
        hw, session = hardware_id("uav3"), 7 << 16 | keys.swarm_mark
        sealer = Sealer(keys.group, hw, session)
        async with dealer(keys, server, port) as connection:
            connection.send(encode(order("uav3", 0, one.app.clock.now_ns())))
            assert (await anext(box)).value == "hostile", "it is a member"
            await hand_over(one, root.revoke("uav3"))
            for number in range(1, TRIES + 1):
                connection.send(encode(order("uav3", number, one.app.clock.now_ns())))
            before = (await one.until_counted(lambda traffic: traffic.refused.revoked > 0)).refused.revoked
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as air:
                for sequence in range(1, TRIES + 1):
                    clear = codec.encode_header(Header(keys.group.mark, hw, sequence, 0, session))
                    beacon = clear + sealer.seal(sequence, clear, codec.encode(Beacon()))
                    air.sendto(beacon, ("127.0.0.1", udp))
                    if sequence % 50 == 0:
                        await asyncio.sleep(0)  # the broker empties its buffer
            traffic = await one.until_counted(lambda traffic: traffic.refused.revoked >= before + TRIES)
        found = await found_by_doctor(one, "refused")
        assert found.verdict == "warning"
        assert f"{traffic.refused.revoked} revoked" in found.text
        assert any("refused input: " in line and " revoked" in line for line in caplog.messages)
        assert len([line for line in caplog.messages if "uav3" in line]) < TRIES / 10
        await until_has(pair["uav2"].app.reader("net/roster", RosterState), 2)
        assert (await pair["uav2"].app.send("/uav1/" + PATH, Text("member"), timeout_s=PATIENCE_S)).delivered
        assert (await anext(box)).value == "member", "the orders of the revoked one are not there"
        assert len(box) == 0
