"""Reception between nodes that drive about in a square, with radios of limited range."""

import random
from collections import deque
from collections.abc import Iterable


class Radio:
    """Positions, neighbours, and the parts into which the net falls."""

    def __init__(
        self, names: Iterable[str], rnd: random.Random, *, side_m: float, range_m: float, speed_m_s: float
    ) -> None:
        self._side_m = side_m
        self._range_m = range_m
        names = list(names)
        self._at = {name: (rnd.uniform(0, side_m), rnd.uniform(0, side_m)) for name in names}
        self._speed = {name: (rnd.gauss(0, 1) * speed_m_s, rnd.gauss(0, 1) * speed_m_s) for name in names}
        # dicts, not sets: their order is the same in every run
        self.near: dict[str, dict[str, None]] = {}
        self.part: dict[str, int] = {}
        """Nodes of the same part can reach each other."""

    def move(self, step_s: float) -> None:
        """All nodes drive on, and turn back at the edge."""
        for name, (x, y) in self._at.items():
            vx, vy = self._speed[name]
            if not 0 < x + vx * step_s < self._side_m:
                vx = -vx
            if not 0 < y + vy * step_s < self._side_m:
                vy = -vy
            self._speed[name] = (vx, vy)
            self._at[name] = (x + vx * step_s, y + vy * step_s)

    def look(self, alive: list[str]) -> None:
        """Find neighbours and parts again, of those that are switched on."""
        reach = self._range_m
        near: dict[str, dict[str, None]] = {name: {} for name in alive}
        order = sorted(alive, key=lambda name: self._at[name][0])
        for i, one in enumerate(order):
            x, y = self._at[one]
            for other in order[i + 1 :]:
                ox, oy = self._at[other]
                if ox - x > reach:
                    break
                if (ox - x) ** 2 + (oy - y) ** 2 <= reach * reach:
                    near[one][other] = None
                    near[other][one] = None
        self.near = near
        self.part = {}
        for number, name in enumerate(alive):
            if name not in self.part:
                self._spread(name, number)

    def _spread(self, name: str, number: int) -> None:
        queue = deque([name])
        self.part[name] = number
        while queue:
            for other in self.near[queue.popleft()]:
                if other not in self.part:
                    self.part[other] = number
                    queue.append(other)

    def way(self, one: str, other: str) -> bool:
        """Whether a message gets from one to the other."""
        number = self.part.get(one)
        return number is not None and number == self.part.get(other)
