"""The smallest functional module: reads where the vehicle is, and goes where it is told, step by step.

Run it on a node:  SWARM_CONFIG=/etc/swarm python hello.py
"""

import asyncio

from swarmware import Module
from swarmware.types.navigation import Goal
from swarmware.types.vehicle import Pose


async def main() -> None:
    async with Module("hello") as m:  # joins the node: no start order, no server to find
        pose = m.reader("nav/pose", Pose)  # board: the newest value
        goal = m.inbox("cmd/goto", Goal)  # messages: each exactly once, acknowledged
        path = m.stream_writer("plan/path", Pose)  # stream: every step, in order
        async for g in goal:
            here = pose.value or Pose(0.0, 0.0)
            for part in (0.25, 0.5, 0.75, 1.0):
                path.write(
                    Pose(
                        here.x_m + part * (g.x_m - here.x_m),
                        here.y_m + part * (g.y_m - here.y_m),
                        here.z_m + part * (g.z_m - here.z_m),
                    )
                )


if __name__ == "__main__":
    asyncio.run(main())
