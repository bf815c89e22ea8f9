"""A member with valid keys relays invented poses of another one, in the beacons that it seals."""

import asyncio
import logging
from contextlib import AsyncExitStack
from itertools import count
from pathlib import Path
from typing import Final

import msgspec
import pytest
from tests.integration.broker.hostile import found_by_doctor
from tests.integration.broker.swarm import LINE, Station, on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmd.broker.core.beacon.beacon import OutgoingBeacon, RelayedValue
from swarmd.broker.core.beacon_protocol import BeaconProtocol
from swarmware.model.names import data_id, hardware_id
from swarmware.module.board import BoardReader
from swarmware.types.net import Denial
from swarmware.types.vehicle import Pose

TRIES: Final = 1000
EACH: Final = 15
"""Invented values in a beacon."""
NAMES: Final = ("uav1", "uav2", "uav3")
POSE: Final = data_id("nav/pose", "Pose")
INVENTED_Y_M: Final = 666.0


class Forger:
    """Adds invented poses of uav3 to the beacons of uav2: a program with the keys of uav2 can do that."""

    def __init__(self) -> None:
        self.sent = 0
        self.ahead_ns = 0
        self.forges = False
        self.stolen = 0
        """Beacons with a false value that has the proof of a true one."""
        self.keeps = False
        """Whether the node also relays the true values, one of them altered but with its true proof."""
        self._compose = BeaconProtocol.compose

    def compose(self, protocol: BeaconProtocol, now_ns: int) -> OutgoingBeacon:
        outgoing = self._compose(protocol, now_ns)
        if protocol.identity.platform != "uav2" or not self.forges:
            return outgoing
        # all nodes of this test have the clock of this computer
        payload = Pose.planar(0.0, INVENTED_Y_M).pack()
        relays = tuple(
            RelayedValue(
                hardware_id("uav3"), POSE, (now_ns + self.ahead_ns) // 1000 + each, 0, 2, True, payload
            )
            for each in range(EACH)
        )
        if self.keeps:
            true = outgoing.beacon.relays
            relays = (*true, *relays)
            if true and true[0].proof is not None:
                relays = (msgspec.structs.replace(true[0], payload=payload), *relays[1:])
                self.stolen += 1
        self.sent += EACH
        return msgspec.structs.replace(
            outgoing, beacon=msgspec.structs.replace(outgoing.beacon, relays=relays)
        )


@pytest.fixture
def forger(monkeypatch: pytest.MonkeyPatch) -> Forger:
    made = Forger()

    def compose(protocol: BeaconProtocol, now_ns: int) -> OutgoingBeacon:
        return made.compose(protocol, now_ns)

    monkeypatch.setattr(BeaconProtocol, "compose", compose)
    return made


def plan(line: dict[str, Station]) -> BoardReader[Pose]:
    line["uav3"].plan([("nav/pose", Pose)])
    line["uav1"].plan(wants=[("uav3", "nav/pose", Pose)])
    return line["uav1"].app.reader("/uav3/nav/pose", Pose)


@pytest.mark.parametrize(("hear", "via"), [(LINE, "uav2"), (None, "uav3")])
@on_uvloop
async def test_invented_values_are_refused_and_relay_is_named(
    tmp_path: Path,
    forger: Forger,
    caplog: pytest.LogCaptureFixture,
    hear: dict[str, tuple[str, ...]] | None,
    via: str,
) -> None:
    caplog.set_level(logging.INFO)
    async with swarm(tmp_path, *NAMES, hear=hear) as line, AsyncExitStack() as stack:
        owner, pose = line["uav1"], plan(line)
        writer = line["uav3"].app.writer("nav/pose", Pose)
        denials = owner.app.stream_reader("net/denials", Denial)
        await owner.until_reaches(uav3=via)
        taken: list[Pose] = []

        async def drive() -> None:
            for step in count():
                writer.write(Pose.planar(float(step), 0.0))
                await asyncio.sleep(0.05)

        async def arrive(number: int) -> None:
            seen = len(taken)
            while len(taken) < seen + number:
                await pose.changed()
                if pose.value is not None:
                    taken.append(pose.value)

        driving = asyncio.create_task(drive(), name="uav3 moves")
        stack.callback(driving.cancel)
        await arrive(1)
        assert (await owner.traffic()).refused.unsigned_values == 0
        forger.ahead_ns, forger.keeps, forger.forges = 500_000_000, True, True
        await owner.until_counted(lambda traffic: traffic.refused.unsigned_values >= TRIES)
        forger.forges = False
        await arrive(2)
        assert forger.sent + forger.stolen >= TRIES
        assert hear is None or forger.stolen > 0, "where values are relayed"
        assert {value.y_m for value in taken} == {0.0}
        denial = await denials.next(PATIENCE_S)
        assert (denial.platform, denial.verb, denial.path) == ("uav2", "relay", "/uav3/nav/pose")
        assert denial.reason.endswith("without a valid signature of uav3, relayed by uav2")
        found = await found_by_doctor(owner, "denied")
        assert found.text.startswith("operator@uav2: /uav3/nav/pose: ")
        assert "revoke it" in found.advice
        assert "unsigned_values" in (await found_by_doctor(owner, "refused")).text
        assert any("valid signature of uav3" in record.getMessage() for record in caplog.records)
