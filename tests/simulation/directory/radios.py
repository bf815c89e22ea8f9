"""Radios on a plane in virtual time: who receives whom depends on the distance, and the radios move."""

import math
from typing import Final

import numpy as np

from swarmware.testing.virtual import VirtualSwarm

RADIO_M: Final = 300.0

Ratios = np.ndarray[tuple[int, int], np.dtype[np.float64]]


class RadioSwarm(VirtualSwarm[str]):
    """A random geometric graph of radios with a mean `degree` of neighbours.

    98 % of the datagrams arrive within 0.7 of the range, none beyond 1.15 of it.
    """

    def __init__(
        self, seed: int, count: int, degree: float, *, delay_s: tuple[float, float], loss: float = 0.0
    ) -> None:
        super().__init__(seed, loss=loss, delay_s=delay_s)
        self.draw = np.random.default_rng(seed)
        self.names = [f"uav{index + 1}" for index in range(count)]
        self.side_m = math.sqrt(count * math.pi * RADIO_M**2 / degree)
        self.place(self.draw.uniform(0, self.side_m, (count, 2)))

    def place(self, position: Ratios) -> None:
        """Sets where the radios are."""
        self.position = position
        apart = position[:, None, :] - position[None, :, :]
        distance = np.sqrt((apart**2).sum(axis=2)) / RADIO_M
        self.delivery: Ratios = np.clip((1.15 - distance) / 0.45, 0, 1) * 0.98
        np.fill_diagonal(self.delivery, 0)
        self._in_range = {
            name: [(self.names[peer], float(row[peer])) for peer in np.nonzero(row > 0.02)[0]]
            for name, row in zip(self.names, self.delivery, strict=True)
        }

    def multicast(self, sender: str, data: bytes) -> None:
        """Send a datagram to all in range; each receives it with the probability of its distance."""
        self.counts["sent"] += 1
        chance = self.random.random
        for receiver, delivery in self._in_range[sender]:
            if chance() < delivery:
                self._carry(sender, receiver, data)
