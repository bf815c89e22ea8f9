"""Inputs of the navigator: a vehicle at rest reads no poses of others, and all of them when it is armed."""

from pathlib import Path
from typing import Any

import pytest

from swarmd.navigator.inputs import GuidanceInputs, StateInputs
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import data_id
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types import registry
from swarmware.types.control import ControlState
from swarmware.types.navigation import Goal
from swarmware.types.vehicle import Pose, Range, VehicleState


class Navigator:
    """A core that records the passed inputs."""

    def __init__(self) -> None:
        self.vehicle: VehicleState | None = None
        self.neighbours: list[tuple[str, float]] = []

    @property
    def resting(self) -> bool:
        return self.vehicle is not None and self.vehicle.resting

    def on_vehicle(self, state: VehicleState) -> None:
        self.vehicle = state

    def on_control(self, control: ControlState) -> None:
        raise AssertionError("nobody writes it")

    def on_scan(self, scan: Range, stamp_ns: int) -> None:
        raise AssertionError("nobody writes it")

    def on_goal(self, goal: Goal, now_ns: int) -> None:
        raise AssertionError("nobody writes it")

    def on_neighbour(self, platform: str, pose: Pose, stamp_ns: int) -> None:
        self.neighbours.append((platform, pose.x_m))


@pytest.mark.parametrize("platforms", [1, 3])
async def test_resting_vehicle_reads_no_neighbour(tmp_path: Path, platforms: int) -> None:
    async with tmp_node(tmp_path) as node, Module("navigator", node=node) as m:
        state = m.writer("vehicle/state", VehicleState)
        names = [f"uav{number}" for number in range(2, 2 + platforms)]
        inputs, states, navigator = GuidanceInputs(m), StateInputs(m), Navigator()

        def feed() -> list[tuple[str, float]]:
            navigator.neighbours.clear()
            states.feed(navigator)
            inputs.feed(navigator, m.now_ns())
            return sorted(navigator.neighbours)

        def write(name: str, x_m: float) -> None:
            frame = Frame(FrameKind.BOARD, data_id("nav/pose", "Pose"), stamp_ns=m.now_ns())
            frame.payload = registry.encode(Pose(x_m, 0.0))
            mirrors[name].publish(encode(frame))

        state.write(VehicleState(armed=False, landed=True))
        for _ in range(7):
            assert feed() == []
        mirrors: dict[str, Any] = {name: node.mirror_writer(name, "nav/pose") for name in names}
        for x_m in (1.0, 2.0):
            for name in names:
                write(name, x_m)
            assert feed() == [], "at rest"
        state.write(VehicleState(armed=True, landed=True))
        assert feed() == [(name, 2.0) for name in names], "the newest of each, in this step"
        assert feed() == []
        for mirror in mirrors.values():
            mirror.close()
