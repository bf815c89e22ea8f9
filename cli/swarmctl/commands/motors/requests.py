"""Sends requests to the motors of vehicles."""

import asyncio
from collections.abc import Mapping

from swarmctl.session.session import Session
from swarmctl.terminal.confirmation import confirm
from swarmctl.vehicles.observer import (
    CommandResult,
    VehicleObserver,
    VehicleResult,
    print_result,
    raise_failures,
)
from swarmctl.vehicles.selection import choose
from swarmware.errors import NoAnswer, SwarmError
from swarmware.model import names
from swarmware.model.platform_kind import NO_KIND, PlatformKind
from swarmware.types.vehicle import ArmRequest, KillRequest, VehicleState

ARM = "sys/vehicle/arm"
KILL = "sys/vehicle/kill"

Request = ArmRequest | KillRequest


class MotorRequests:
    """One request to some vehicles, followed until each reports its motors as requested."""

    def __init__(
        self, session: Session, path: str, value: Request, chosen: Mapping[str, PlatformKind], wait_s: float
    ) -> None:
        self._session = session
        self._path = path
        self._value = value
        self._armed = isinstance(value, ArmRequest) and value.armed
        self._chosen = chosen
        self._wait_s = wait_s
        self._observer = VehicleObserver(session, chosen)
        self._begin_ns = session.module.now_ns()

    async def run(self) -> list[VehicleResult]:
        """Sends the request to all vehicles concurrently.

        Raises: the refusal, of a single vehicle.
        """
        return list(await asyncio.gather(*(self._one(name) for name in self._chosen)))

    async def _one(self, name: str) -> VehicleResult:
        state: VehicleState | None = None
        try:
            async with asyncio.timeout(self._wait_s):
                await self._session.reach(name)
                state = await self._session.module.request(
                    names.join(name, self._path),
                    self._value,
                    VehicleState,
                    timeout_s=self._wait_s,
                    urgent=True,
                )
                # The answer holds the state when the device accepted the order, which may be the former one.
                while state.armed != self._armed:
                    await self._observer.changed()
                    state = self._observer.snapshot(name).vehicle or state
        except TimeoutError:
            return self._seen(name, state, f"not confirmed by its state within {self._wait_s:g} s")
        except SwarmError as error:
            # The error of a single vehicle keeps its own exit code; among several it becomes one row of the
            # result.
            if len(self._chosen) == 1:
                raise
            return self._seen(name, None, str(error), reached=not isinstance(error, NoAnswer))
        return self._seen(name, state)

    def _seen(
        self, name: str, state: VehicleState | None, text: str = "", *, reached: bool | None = None
    ) -> VehicleResult:
        after_s = (self._session.module.now_ns() - self._begin_ns) / 1e9
        got = state is not None if reached is None else reached
        seen = self._observer.result(name, not text, got, after_s, text, state)
        print_result(self._session, seen)
        return seen


async def arm(
    session: Session, wanted: tuple[str, ...], wait_s: float, reason: str, *, yes: bool, force: bool
) -> None:
    """Arms vehicles on the ground, after a confirmation that names them; `force`: also those not ready.

    Raises: as `choose`, `confirm` and `MotorRequests.run`.
    """
    chosen = await choose(session, wanted)
    unready = ", also if not ready" if force else ""
    confirm(yes, f"arm {', '.join(chosen)}{unready}: motors may turn")
    await _request(session, "arm", ARM, ArmRequest(True, force, reason), chosen, wait_s)


async def disarm(session: Session, wanted: tuple[str, ...], wait_s: float) -> None:
    """Disarms vehicles on the ground.

    Raises: as `choose` and `MotorRequests.run`.
    """
    chosen = await choose(session, wanted)
    await _request(session, "disarm", ARM, ArmRequest(False), chosen, wait_s)


async def kill(session: Session, platform: str, reason: str, wait_s: float) -> None:
    """Stops the motors of one vehicle, also in the air.

    Raises: as `MotorRequests.run`.
    """
    await _request(session, "kill", KILL, KillRequest(platform, reason), {platform: NO_KIND}, wait_s)


async def _request(
    session: Session, name: str, path: str, value: Request, chosen: Mapping[str, PlatformKind], wait_s: float
) -> None:
    found = await MotorRequests(session, path, value, chosen, wait_s).run()
    if session.settings.structured:
        session.out.document(CommandResult(name, found))
    raise_failures(name, found)
