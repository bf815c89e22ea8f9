"""Roles of missions that several tests use."""

from typing import Final

AIR_AND_CONTROL: Final = """
[[roles]]
name = "air"
file = "air.json"
kinds = ["uav"]
[roles.params]
height = {first = 5.0, step = 1.5}
[[roles]]
name = "control"
file = "control.json"
kinds = ["gcs"]
required = false
"""
"""Each aircraft has its own height; a ground station takes part where there is one."""
