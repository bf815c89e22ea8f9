"""The shell of control: boards, manual set-points and requests in, commands to the chassis out."""

import asyncio
from typing import ClassVar, Final

from swarmd.control import config as settings
from swarmd.control.core.control import Action, ControlCore, Operator, PublishMode, WriteDrive
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.service.service import Service
from swarmware.types.control import ControlState, Drive, DriveRequest, SafetySwitch
from swarmware.types.vehicle import Setpoint

MANUAL: Final = "cmd/manual"
_RATE_HZ: Final = 20.0
"""Rate of the navigator's set-points."""


class Control(Service):
    """Passes the set-points of navigator or operator on to the chassis, by the table of modes."""

    name = "control"
    Config: ClassVar = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        former = module.reader("control/state", ControlState)
        self._core = ControlCore(config, former.value)
        # only the state at the start counts; this service then writes the board itself
        former.close()
        self._driver = self.drive(self._core, self._perform)
        self._drives = module.writer(
            "act/drive", Drive, rate_hz=_RATE_HZ, description="Command to the chassis, with its source"
        )
        self._states = module.writer(
            "control/state",
            ControlState,
            log="all",
            link="notify",
            description="Mode, and holder of the stick",
        )
        self._setpoints = module.reader("act/setpoint", Setpoint)
        self._switch = module.reader("vehicle/switch", SafetySwitch)
        self._sticks = module.reader("vehicle/sticks", Setpoint)
        self._manual = module.inbox(MANUAL, Setpoint, limit=4, description="Manual set-point, by its stamp")
        module.serve(
            "sys/vehicle/drive",
            DriveRequest,
            self._on_request,
            reply=ControlState,
            description="Request the stick of the vehicle, or release it",
        )

    async def run(self) -> None:
        """Passes set-points on until the service ends."""
        self._states.write(self._core.state)
        async with asyncio.TaskGroup() as group:
            group.create_task(self._driver.run(), name="control:driver")
            group.create_task(self._take_setpoints(), name="control:setpoints")
            group.create_task(self._take_switch(), name="control:switch")
            group.create_task(self._take_sticks(), name="control:sticks")
            group.create_task(self._take_manual(), name="control:manual")

    async def stop(self) -> None:
        """Writes a last command that stops the vehicle."""
        # without it the vehicle keeps its last speed until the time-out of the chassis
        self._drives.write(Drive(0.0, mode=self._core.state.mode))

    async def _take_setpoints(self) -> None:
        reader, core, module = self._setpoints, self._core, self.module
        async for setpoint in reader:
            now_ns = module.now_ns()
            self._driver.feed(core.on_setpoint(setpoint, reader.local_stamp_ns or now_ns, now_ns))

    async def _take_switch(self) -> None:
        async for switch in self._switch:
            self._driver.feed(self._core.on_switch(switch.mode, self.module.now_ns()))

    async def _take_sticks(self) -> None:
        reader, core, module = self._sticks, self._core, self.module
        async for setpoint in reader:
            now_ns = module.now_ns()
            age_s = reader.age_s
            stamp_ns = now_ns if age_s is None else now_ns - round(age_s * 1e9)
            self._driver.feed(core.on_sticks(setpoint, stamp_ns, now_ns))

    async def _take_manual(self) -> None:
        async for setpoint in self._manual:
            meta = self._manual.meta
            if meta is None:
                continue
            now_ns = self.module.now_ns()
            stamp_ns = self._local_ns(meta, now_ns)
            self._driver.feed(self._core.on_manual(setpoint, _sender_id(meta), stamp_ns, now_ns))

    def _local_ns(self, meta: Meta, now_ns: int) -> int:
        """Stamp of a message in the own clock, or its arrival while the sender's clock is not known."""
        if meta.sender_hw == self.module.node.hardware:
            return meta.stamp_ns
        stamp_ns = self.module.remote_clocks.to_local(meta.sender_hw, meta.stamp_ns)
        return (meta.arrived_ns or now_ns) if stamp_ns is None else stamp_ns

    def _on_request(self, request: DriveRequest, meta: Meta) -> ControlState:
        operator = Operator(_sender_id(meta), self.module.requester(meta))
        self._driver.feed(self._core.on_request(request, operator, self.module.now_ns()))
        return self._core.state

    def _perform(self, action: Action) -> None:
        match action:
            case WriteDrive(drive, stamp_ns):
                self._drives.write(drive, stamp_ns)
            case PublishMode(state):
                self._states.write(state)
                self.module.log.info("mode %s by %s %s", state.mode, state.event, state.holder)


def _sender_id(meta: Meta) -> int:
    """Identifier of the application that sent a request or message."""
    return meta.sender_hw << 32 | meta.sender_app
