"""Whole stations in virtual time, datagrams sealed and encoded as on the wire: poses of moving, lossy swarms.

Five seeds of 16 nodes that all want all poses at 10 Hz: how old the poses are by distance, that every
platform's name and tree are known everywhere, and what it costs in bytes; the same of 100, and of 16 in one
cell.
"""

import heapq
import math
import random
from collections import defaultdict
from typing import Final

import numpy as np
import pytest

from swarmd.broker.config import Config
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Header, PlatformCode
from swarmd.broker.core.beacon_protocol import BeaconProtocol, NodeIdentity
from swarmd.broker.core.topology.topology import Topology
from swarmd.broker.core.traffic import Counters
from swarmware.model.names import data_id, hardware_id
from swarmware.transport.security import GroupKey, Opened, Opener, Sealer
from swarmware.types.net import BoardPublication, BoardSubscription, TreePlan
from swarmware.types.vehicle import Pose

SECOND: Final = 1_000_000_000
PERIOD: Final = SECOND // 10
GROUP: Final = GroupKey(0, bytes(32))
POSE: Final = data_id("nav/pose", "Pose")
RADIO_M: Final = 300.0


class Radio:
    """One node: beacon protocol, seal, and what it has read."""

    def __init__(self, name: str, others: list[str], offset_ns: int) -> None:
        self.hw = hardware_id(name)
        self.offset_ns = offset_ns
        """Its clock minus the true one."""
        self.counters = Counters()
        topology = Topology(self.hw, 1, SECOND, 0)
        identity = NodeIdentity(self.hw, name, "main", PlatformCode.UAV, 1, b"")
        self.protocol = BeaconProtocol(
            identity, topology, self.counters, busy_hz=10.0, relay_bytes_s=Config().relay_bytes_s
        )
        self.sealer = Sealer(GROUP, self.hw, 1)
        self.opener = Opener(GROUP)
        wants = tuple(BoardSubscription(other, "nav/pose", "Pose", POSE) for other in others)
        self.protocol.set_plan(
            TreePlan(hash(name) & 0xFFFF, (BoardPublication("nav/pose", POSE, "Pose"),), wants)
        )
        self.made_s: dict[str, float] = {}
        """By platform: when the newest pose that is here was made (a pose says so in its x)."""
        self.sent_bytes = 0


class Air:
    """All nodes, where they are, and who hears whom."""

    def __init__(self, seed: int, count: int, degree: float, speed_m_s: float) -> None:
        self.random = random.Random(seed)
        draw = np.random.default_rng(seed)
        side_m = math.sqrt(count * math.pi * RADIO_M**2 / degree)
        self.position = draw.uniform(0, side_m, (count, 2))
        self.velocity = draw.normal(0, speed_m_s / math.sqrt(2), (count, 2))
        names = [f"uav{index + 1}" for index in range(count)]
        self.radios = [
            Radio(name, [other for other in names if other != name], self.random.randrange(-5, 5) * SECOND)
            for name in names
        ]
        self.names = names
        self.delivery = self.hears()
        self.now_ns = 0
        self.ages_s: dict[int, list[float]] = defaultdict(list)
        self.events = [(self.random.randrange(PERIOD), index) for index in range(count)]
        heapq.heapify(self.events)

    def hears(self) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        apart = self.position[:, None, :] - self.position[None, :, :]
        distance = np.sqrt((apart**2).sum(axis=2)) / RADIO_M
        delivery: np.ndarray[tuple[int, int], np.dtype[np.float64]] = (
            np.clip((1.15 - distance) / 0.45, 0, 1) * 0.98
        )
        np.fill_diagonal(delivery, 0)
        return delivery

    def run(self, seconds: float) -> None:
        until_ns = self.now_ns + int(seconds * SECOND)
        while self.events[0][0] <= until_ns:
            self.now_ns, index = heapq.heappop(self.events)
            radio = self.radios[index]
            self.send(index, radio)
            period_ns = SECOND / radio.protocol.beacon_hz()
            heapq.heappush(
                self.events, (self.now_ns + int(period_ns * self.random.uniform(0.95, 1.05)), index)
            )
        self.now_ns = until_ns

    def send(self, index: int, radio: Radio) -> None:
        now_ns = self.now_ns + radio.offset_ns
        protocol = radio.protocol
        protocol.advance(now_ns)
        pose = Pose.planar(self.now_ns / SECOND, 0.0).pack()
        protocol.published.boards[POSE].put(pose, True, now_ns)
        outgoing = protocol.compose(now_ns)
        session = 1 if outgoing.with_session else None
        clear = codec.encode_header(
            Header(0, radio.hw, outgoing.sequence, now_ns // 1000 & 0xFFFF_FFFF, session)
        )
        data = clear + radio.sealer.seal(outgoing.sequence, clear, codec.encode(outgoing.beacon))
        assert len(data) <= 1238
        protocol.sent(outgoing.sequence, now_ns, len(data))
        radio.sent_bytes += len(data) + 28
        for peer, delivery in enumerate(self.delivery[index]):
            if delivery and self.random.random() < delivery:
                self.receive(self.radios[peer], data)

    def receive(self, radio: Radio, data: bytes) -> None:
        header, start = codec.decode_header(data)
        opened = radio.opener.open(
            header.epoch, header.sender_hw, header.session, header.sequence, data[:start], data[start:]
        )
        if not isinstance(opened, Opened):
            return
        received = radio.protocol.on_beacon(
            header, codec.decode(opened.body), ("10.0.0.1", 1), self.now_ns + radio.offset_ns
        )
        assert received is not None
        for want, value in received.values:
            made_s = Pose.unpack(value.payload).x_m
            assert made_s >= radio.made_s.get(want.platform, 0.0), "an older pose replaced a newer one"
            radio.made_s[want.platform] = made_s
            origin = self.radios[self.names.index(want.platform)]
            true_stamp_us = made_s * 1e6 + origin.offset_ns / 1000
            assert value.stamp_us == pytest.approx(true_stamp_us, abs=1500), "stamp on the origin's clock"
            age_s = self.now_ns / SECOND - made_s
            # from 3.2 s on, ages travel in steps of 0.1 s, rounded down at each hop
            assert value.age_us / 1e6 == pytest.approx(age_s, abs=0.02 if age_s < 3.2 else 1.5)

    def look(self) -> None:
        """Ages of all poses, by distance in good hops."""
        hops = self.distances()
        for index, radio in enumerate(self.radios):
            for other, name in enumerate(self.names):
                if other != index and hops[index][other]:
                    age_s = self.now_ns / SECOND - radio.made_s.get(name, 0.0)
                    self.ages_s[int(hops[index][other])].append(age_s)

    def distances(self) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
        """Hops over good links; 0: not connected."""
        count = len(self.radios)
        good = self.delivery > 0.85
        reached = np.eye(count, dtype=bool)
        hops = np.zeros((count, count), dtype=np.int64)
        for distance in range(1, count):
            further = (reached.astype(np.uint8) @ good.astype(np.uint8) > 0) & ~reached
            hops[further] = distance
            reached |= further
        return hops

    def move(self, seconds: float) -> None:
        self.position = self.position + self.velocity * seconds
        self.delivery = self.hears()


def test_poses_of_16_moving_nodes_are_fresh_everywhere_and_cheap() -> None:
    ages_s: dict[int, list[float]] = defaultdict(list)
    for seed in range(5):
        air = Air(seed, count=16, degree=6.0, speed_m_s=5.0)
        air.run(4.0)
        warm_bytes = sum(radio.sent_bytes for radio in air.radios)
        for _ in range(16):
            air.run(0.5)
            air.move(0.5)
            air.look()
        per_node = (sum(radio.sent_bytes for radio in air.radios) - warm_bytes) / 16 / 8.0
        assert per_node <= 2200, "bytes per node and second"
        assert max(air.ages_s) >= 3, "this seed shows nothing about many hops"
        for hops, found_s in air.ages_s.items():
            ages_s[hops] += found_s
        distances = air.distances()
        for index, radio in enumerate(air.radios):
            for other, name in enumerate(air.names):
                if distances[index][other]:
                    member = radio.protocol.nodes.get(hardware_id(name))
                    assert member is not None
                    assert member.platform == name
    # of all swarms together: in one of them a single node at the edge decides about three hops
    for hops, limit_s in ((1, 0.15), (2, 0.35), (3, 0.65)):
        assert np.quantile(np.array(ages_s[hops]), 0.95) <= limit_s


def test_poses_of_100_moving_nodes_stay_within_their_bytes_and_are_fresh_nearby() -> None:
    air = Air(0, count=100, degree=9.0, speed_m_s=5.0)
    for _ in range(14):  # until all names are known
        air.run(0.5)
        air.move(0.5)
    warm_bytes = sum(radio.sent_bytes for radio in air.radios)
    for _ in range(4):
        air.run(0.5)
        air.move(0.5)
        air.look()
    per_node = (sum(radio.sent_bytes for radio in air.radios) - warm_bytes) / 100 / 2.0
    assert per_node <= 3800, "bytes per node and second"
    assert np.quantile(np.array(air.ages_s[1]), 0.95) <= 0.25
    assert np.quantile(np.array(air.ages_s[2]), 0.95) <= 0.6


@pytest.mark.parametrize("seed", range(1, 4))
def test_poses_of_16_nodes_in_one_cell_are_not_relayed(seed: int) -> None:
    air = Air(seed, count=16, degree=300.0, speed_m_s=0.0)
    air.run(3.0)
    warm_bytes = sum(radio.sent_bytes for radio in air.radios)
    air.run(10.0)
    total = (sum(radio.sent_bytes for radio in air.radios) - warm_bytes) / 10.0
    assert total <= 16_000, "bytes per second of all 16 together"
    air.look()
    assert set(air.ages_s) == {1}
    assert max(air.ages_s[1]) < 0.5
