"""Tests of my_name, without a running node: each makes one in a temporary folder."""

import asyncio
from pathlib import Path

import pytest
from swarmware import Module
from swarmware.errors import ConfigError
from swarmware.model.config import load_service
from swarmware.testing.tmpnode import make_node, tmp_node
from swarmware.types.scalar import Float
from swarmware.types.vehicle import Pose

import my_name


def test_the_distance_of_the_newest_pose_is_published(tmp_path: Path) -> None:
    async def check() -> None:
        async with tmp_node(tmp_path) as node, Module("my_name", node=node) as module:
            pose = module.writer("nav/pose", Pose)
            pose.write(Pose(3.0, 4.0, 12.0))
            distance = module.reader("my_name/distance", Float)
            settings = my_name.Settings(rate_hz=50.0)
            service = my_name.MyName(module, settings)
            module.start(service.run(), "run")
            assert await distance.changed(timeout_s=10.0) == Float(13.0)

    asyncio.run(check())


def test_a_setting_outside_its_range_is_refused(tmp_path: Path) -> None:
    folder = make_node(tmp_path, services={"my_name": {"limit_m": -1.0}})
    with pytest.raises(ConfigError, match="limit_m"):
        load_service(folder, "my_name", my_name.Settings)
