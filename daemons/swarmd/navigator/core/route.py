"""Search of a route around the obstacles that a blocked vehicle has seen, as the shortest path on a grid.

A detour next to the commanded direction ends in front of a wall or in a corner; a route leads out of it.
Source: Hart, Nilsson, Raphael: A formal basis for the heuristic determination of minimum cost
paths, 1968 (A*).
"""

import heapq
import math
from collections.abc import Iterable
from typing import Final

CELL_M: Final = 0.5
"""Size of a cell; gaps narrower than the vehicle plus a cell are not found."""
CELLS_LIMIT: Final = 4_000
"""Maximum number of stored cells with echoes, 1 000 m of walls; the oldest cells are evicted."""
MARGIN_M: Final = 15.0
"""Maximum distance of the route from the straight line between its ends, in x and y."""
REACH_M: Final = 30.0
"""Maximum distance of the end of the route, from which a farther goal is steered to directly."""
STEPS: Final = 150
"""Cells that are expanded per control step, in less than 2 ms, so that no step is late."""

Point = tuple[float, float]
Cell = tuple[int, int]
_NEXT: Final = [(x, y, math.hypot(x, y)) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]


class SeenObstacles:
    """Cells in which echoes were received since the goal arrived."""

    def __init__(self) -> None:
        self._cells: dict[Cell, None] = {}

    def clear(self) -> None:
        """Forgets all stored cells."""
        self._cells.clear()

    def add(self, points_m: Iterable[Point]) -> None:
        """Takes echoes in map coordinates."""
        for x, y in points_m:
            self._cells[_cell(x, y)] = None
        # a dict keeps the order of insertion
        while len(self._cells) > CELLS_LIMIT:
            del self._cells[next(iter(self._cells))]

    def occupied(self, width_m: float) -> frozenset[Cell]:
        """Cells in which the centre of a vehicle of this half width would touch a cell with echoes."""
        reach = math.ceil(width_m / CELL_M)
        disc = [
            (x, y)
            for x in range(-reach, reach + 1)
            for y in range(-reach, reach + 1)
            if math.hypot(x, y) * CELL_M <= width_m
        ]
        return frozenset((x + dx, y + dy) for x, y in self._cells for dx, dy in disc)


class RouteSearch:
    """Searches a route from a position towards a goal, a few cells in each control step."""

    def __init__(self, start: Point, goal: Point, occupied: frozenset[Cell]) -> None:
        distance_m = math.dist(start, goal)
        share = min(1.0, REACH_M / distance_m) if distance_m else 1.0
        self._end = (start[0] + share * (goal[0] - start[0]), start[1] + share * (goal[1] - start[1]))
        self._whole = share == 1.0
        self._first, self._last = _cell(*start), _cell(*self._end)
        # the vehicle is in this cell, so it is free however near the echoes are
        self._occupied = occupied - {self._first}
        margin = round(MARGIN_M / CELL_M)
        xs, ys = zip(self._first, self._last, strict=True)
        self._box = (min(xs) - margin, max(xs) + margin, min(ys) - margin, max(ys) + margin)
        self._cost: dict[Cell, float] = {self._first: 0.0}
        self._came: dict[Cell, Cell] = {}
        self._queue: list[tuple[float, Cell]] = [(0.0, self._first)]
        self._closed: set[Cell] = set()
        self.done = False
        """True when the search is over."""

    def advance(self, steps: int = STEPS) -> list[Point] | None:
        """Expands at most `steps` cells; returns the route without its start once it is found, else None."""
        while self._queue and steps:
            _, cell = heapq.heappop(self._queue)
            # reached before on a shorter path; the queue keeps outdated entries
            if cell in self._closed:
                continue
            self._closed.add(cell)
            if self._is_end(cell):
                self.done = True
                return self._route(cell)
            self._expand(cell)
            steps -= 1
        self.done = not self._queue
        return None

    def _is_end(self, cell: Cell) -> bool:
        """True for the last cell, or for a free cell near an occupied last cell if the goal is farther."""
        if cell == self._last:
            return True
        near = max(abs(cell[0] - self._last[0]), abs(cell[1] - self._last[1])) <= 2
        return near and not self._whole and self._last in self._occupied

    def _expand(self, cell: Cell) -> None:
        low_x, high_x, low_y, high_y = self._box
        for dx, dy, length in _NEXT:
            x, y = cell[0] + dx, cell[1] + dy
            if not (low_x <= x <= high_x and low_y <= y <= high_y) or (x, y) in self._occupied:
                continue
            if (
                dx
                and dy
                and ((cell[0] + dx, cell[1]) in self._occupied or (cell[0], cell[1] + dy) in self._occupied)
            ):
                continue  # no diagonal through the corner between two obstacles
            cost = self._cost[cell] + length
            if cost < self._cost.get((x, y), math.inf):
                self._cost[x, y] = cost
                self._came[x, y] = cell
                left = math.hypot(x - self._last[0], y - self._last[1])
                heapq.heappush(self._queue, (cost + left, (x, y)))

    def _route(self, cell: Cell) -> list[Point]:
        """Corners of the found path; cells in one direction form one leg."""
        cells = [cell]
        while cell in self._came:
            cell = self._came[cell]
            cells.append(cell)
        cells.reverse()
        corners = [
            here
            for before, here, after in zip(cells, cells[1:], cells[2:], strict=False)
            if (here[0] - before[0], here[1] - before[1]) != (after[0] - here[0], after[1] - here[1])
        ]
        return [(x * CELL_M, y * CELL_M) for x, y in corners] + [self._end]


def _cell(x_m: float, y_m: float) -> Cell:
    return round(x_m / CELL_M), round(y_m / CELL_M)
