"""Contacts between platforms: poses of distant platforms need not be read, and no contact is missed."""

import math
import random

import pytest

from swarmd.sim.core.contacts import Contacts
from swarmware.types.vehicle import Pose

RADIUS_M = 0.3
STEP_S = 0.1
STEP_NS = 100_000_000
ACCEL_M_S2 = 9.9
"""Of each: a fall is 9.81."""


class Body:
    """A point with random motion within the bounds of a vehicle, which may stop at once."""

    def __init__(self, chance: random.Random, apart_m: float) -> None:
        self.chance = chance
        self.x = [chance.uniform(-apart_m, apart_m) for _ in range(3)]
        self.v = [chance.uniform(-3, 3) for _ in range(3)]

    def step(self, towards: "Body") -> None:
        if self.chance.random() < 0.05:
            self.v = [0.0, 0.0, 0.0]
        gap = math.dist(self.x, towards.x) or 1.0
        for axis in range(3):
            pull = (towards.x[axis] - self.x[axis]) / gap if self.chance.random() < 0.7 else 0.0
            before = self.v[axis]
            self.v[axis] += pull * ACCEL_M_S2 * STEP_S
            self.x[axis] += (before + self.v[axis]) / 2 * STEP_S

    def pose(self, jitter_m: float = 0.0) -> Pose:
        x = [each + self.chance.uniform(-jitter_m, jitter_m) for each in self.x]
        return Pose.planar(x[0], x[1], x[2], 0.0, (self.v[0], self.v[1], self.v[2]))


@pytest.mark.parametrize("seed", range(200))
def test_skipping_clear_platforms_finds_same_contacts(
    seed: int,
) -> None:
    chance = random.Random(seed)
    one, other = Body(chance, 6.0), Body(chance, 6.0)
    every, seldom = Contacts(RADIUS_M), Contacts(RADIUS_M)
    for step in range(100):
        now_ns = step * STEP_NS
        pose = other.pose(0.1)
        every.on_neighbour("uav2", pose, now_ns)
        if not seldom.is_clear("uav2", now_ns):
            seldom.on_neighbour("uav2", pose, now_ns)
        assert seldom.check(one.pose(), now_ns) == every.check(one.pose(), now_ns), f"step {step}"
        one.step(other)
        other.step(one)


def test_distant_platform_is_read_rarely_close_always() -> None:
    contacts = Contacts(RADIUS_M)
    here = Pose.planar(0.0, 0.0, 5.0, 0.0, (2.0, 0.0, 0.0))
    reads = dict.fromkeys(("far", "close"), 0)
    where = {"far": Pose.planar(10.0, 0.0, 5.0, 0.0, (2.0, 0.0, 0.0)), "close": Pose.planar(1.0, 0.0, 5.0)}
    for step in range(50):
        now_ns = step * STEP_NS
        for platform, pose in where.items():
            if not contacts.is_clear(platform, now_ns):
                reads[platform] += 1
                contacts.on_neighbour(platform, pose, now_ns)
        assert contacts.check(here, now_ns) == []
    assert reads["close"] == 50
    assert reads["far"] <= 50 * STEP_S / 0.5


def test_silent_platform_is_sought_then_forgotten() -> None:
    contacts = Contacts(RADIUS_M)
    contacts.on_neighbour("uav2", Pose.planar(30.0, 0.0), 0)
    assert contacts.check(Pose.planar(0.0, 0.0), 0) == []
    assert contacts.is_clear("uav2", 900_000_000)
    assert not contacts.is_clear("uav2", 1_000_000_000)
    assert contacts.check(Pose.planar(30.0, 0.0), 1_100_000_000) == [], "its pose is too old"
    assert not contacts
