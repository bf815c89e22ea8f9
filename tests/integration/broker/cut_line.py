"""Three brokers with a serial line between each two; one line is cut and heals: when that is noticed.

Real time and real brokers, in one process.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from typing import Final

from tests.integration.broker.lines import Line
from tests.integration.broker.swarm import Station, swarm
from tests.patience import PATIENCE_S

from swarmware.types.scalar import Text

NAMES: Final = ("uav1", "uav2", "uav3")
PAIRS: Final = (("uav1", "uav2"), ("uav2", "uav3"), ("uav1", "uav3"))
BAUD: Final = 921_600


@asynccontextmanager
async def triangle(root: Path) -> AsyncIterator[tuple[Line, dict[str, Station]]]:
    """The line between uav1 and uav2, and the stations."""
    with ExitStack() as stack:
        serial: dict[str, list[dict[str, object]]] = {name: [] for name in NAMES}
        lines: list[Line] = []
        for number, pair in enumerate(PAIRS):
            folder = root / f"line{number}"
            folder.mkdir()
            line = Line(folder)
            lines.append(line)
            stack.callback(line.close)
            for name, device in zip(pair, line.devices, strict=True):
                serial[name].append({"name": f"line{number}", "device": str(device), "baud": BAUD})
        settings = {name: {"serial": own} for name, own in serial.items()}
        async with swarm(root, *NAMES, multicast_group="", settings=settings) as stations:
            for name, station in stations.items():
                await station.until_up(*(other for other in NAMES if other != name))
            yield lines[0], stations


async def cut_and_heal(root: Path) -> dict[str, float]:
    """Times in seconds: loss noticed, route over the third one, first messages after that and the return;
    and the direct route in use again."""
    loop = asyncio.get_running_loop()
    async with triangle(root) as (line, stations):
        one, other = stations["uav1"], stations["uav2"]
        inbox = other.app.inbox("cmd/order", Text)
        await one.until_reaches(uav2="uav2", uav3="uav3")
        assert await one.app.send("/uav2/cmd/order", Text("before"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "before"
        line.cut()
        start_s = loop.time()
        await one.until(lambda: one.states().get("uav2") != "up", one.neighbours)
        noticed_s = loop.time() - start_s
        await one.until_reaches(uav2="uav3")
        rerouted_s = loop.time() - start_s
        assert await one.app.send("/uav2/cmd/order", Text("around"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "around"
        around_s = loop.time() - start_s
        line.heal()
        start_s = loop.time()
        assert await one.app.send("/uav2/cmd/order", Text("back"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "back"
        back_s = loop.time() - start_s
        await one.until_reaches(uav2="uav2")
        return {
            "noticed_s": noticed_s,
            "rerouted_s": rerouted_s,
            "around_s": around_s,
            "back_s": back_s,
            "direct_s": loop.time() - start_s,
        }
