"""Requests to the motors of vehicles, answered by the vehicles themselves."""

import asyncio
from collections.abc import Mapping

from swarmctl.connect import Link
from swarmctl.observing import Observer, Seen, judge, tell
from swarmware import names
from swarmware.errors import NoAnswer, SwarmError
from swarmware.types.vehicle import ArmRequest, KillRequest, VehicleState

ARM = "sys/vehicle/arm"
KILL = "sys/vehicle/kill"

Request = ArmRequest | KillRequest


class Motors:
    """One request to some vehicles, followed until each says that its motors are as they should be."""

    def __init__(
        self, link: Link, path: str, value: Request, chosen: Mapping[str, str], wait_s: float
    ) -> None:
        self._link = link
        self._path = path
        self._value = value
        self._armed = isinstance(value, ArmRequest) and value.armed
        self._chosen = chosen
        self._wait_s = wait_s
        self._observer = Observer(link, chosen)
        self._begin_ns = link.module.now_ns()

    async def run(self) -> list[Seen]:
        """Asks all at once.

        Raises: the refusal, when a single vehicle was asked.
        """
        await self._observer.open()
        return list(await asyncio.gather(*(self._one(name) for name in self._chosen)))

    async def _one(self, name: str) -> Seen:
        state: VehicleState | None = None
        try:
            async with asyncio.timeout(self._wait_s):
                await self._link.reach(name)
                state = await self._link.module.request(
                    names.join(name, self._path),
                    self._value,
                    VehicleState,
                    timeout_s=self._wait_s,
                    urgent=True,
                )
                while state.armed != self._armed:
                    await self._observer.changed()
                    state = self._observer.sight(name).vehicle or state
        except TimeoutError:
            return self._seen(name, state, f"not seen to be done within {self._wait_s:g} s")
        except SwarmError as error:
            if len(self._chosen) == 1:
                raise
            return self._seen(name, None, str(error), reached=not isinstance(error, NoAnswer))
        return self._seen(name, state)

    def _seen(
        self, name: str, state: VehicleState | None, text: str = "", *, reached: bool | None = None
    ) -> Seen:
        after_s = (self._link.module.now_ns() - self._begin_ns) / 1e9
        got = state is not None if reached is None else reached
        seen = self._observer.seen(name, not text, got, after_s, text, state)
        tell(self._link, seen)
        return seen


async def command(
    link: Link, name: str, path: str, value: Request, chosen: Mapping[str, str], wait_s: float
) -> None:
    """`swarmctl arm|disarm|kill` from the names to the result.

    Raises: as `Motors.run` and `judge`.
    """
    found = await Motors(link, path, value, chosen, wait_s).run()
    if link.settings.json:
        link.out.document({"command": name, "vehicles": found})
    judge(name, found)
