"""The verdict held against the player: what is sound never gets stuck, what gets stuck was not sound."""

from collections import Counter
from itertools import count
from random import Random
from typing import Any

import pytest
from tests.unit.mission.nets import choice, net
from tests.unit.mission.results import result

from swarmd.mission.core.player import Player
from swarmd.mission.core.run import (
    CancelBlock,
    EnterBarrier,
    LeaveBarrier,
    PlayEnded,
    PlayerAction,
    StartBlock,
)
from swarmware.mission.binding import Binding
from swarmware.mission.check import check_text
from swarmware.mission.field_path import Scalar
from swarmware.mission.finding import sound
from swarmware.mission.model import Block, MissionDefinition

STEPS = 300
"""Of a play; a loop that goes on by chance is left long before."""


class Nothing:
    """No values: a Decision ends with an error."""

    def value(self, path: str, field: str) -> Scalar | None:
        return None

    def age_s(self, path: str) -> float | None:
        return None


class Author:
    """Writes missions: parts inside parts, then some edges led elsewhere."""

    def __init__(self, seed: int) -> None:
        self._chance = Random(seed)
        self._names = (f"b{n}" for n in count())
        self.blocks: dict[str, Any] = {}

    def mission(self) -> str:
        first = self._part(3, "end")
        self.blocks |= {"start": f"Start>{first}", "end": "End", "other": "End"}
        for _ in range(self._chance.choice([0, 0, 1, 1, 2])):
            self._spoil()
        return net(**self.blocks)

    def _part(self, depth: int, after: str) -> str:
        """A part that leads to `after`; its first block."""
        name = next(self._names)
        kind = self._chance.randrange(6) if depth else self._chance.randrange(2)
        match kind:
            case 0:
                self.blocks[name] = {"type": "Wait", "s": self._chance.choice([0, 1, 1, 2]), "next": after}
            case 1:
                self.blocks[name] = body = {"type": "Arm", "next": after}
                for edge in ("nextError", "nextTimeout"):
                    if self._chance.random() < 0.5:
                        body[edge] = self._chance.choice([after, "other"])
            case 2:
                second = self._part(depth - 1, after)
                return self._part(depth - 1, second)
            case 3:
                self.blocks[name] = f"Join>{after}"
                fork = next(self._names)
                heads = [self._part(depth - 1, name) for _ in range(self._chance.randint(1, 3))]
                self.blocks[fork] = "Fork>" + ",".join(heads)
                return fork
            case 4:
                self.blocks[name] = choice(self._part(depth - 1, after), self._part(depth - 1, after))
            case _:
                self.blocks[name] = choice(self._part(depth - 1, name), after)
                return self._part(depth - 1, name)
        return name

    def _spoil(self) -> None:
        victim = self._chance.choice([name for name in self.blocks if name not in {"end", "other"}])
        target = self._chance.choice([name for name in self.blocks if name != "start"])
        body = self.blocks[victim]
        if isinstance(body, dict):
            body[self._chance.choice([key for key in body if key.startswith("next")])] = target
        else:
            self.blocks[victim] = f"{body.partition('>')[0]}>{target}"


def play(mission: MissionDefinition, chance: Random) -> str:
    """How one play with random outcomes ends."""
    player = Player(mission, Nothing(), chance.random, count(1))
    running: dict[int, Block] = {}
    cancelled: list[int] = []
    now_ns = 0
    actions: list[PlayerAction] = player.start(now_ns)
    for _ in range(STEPS):
        for action in actions:
            match action:
                case StartBlock(token, block) | EnterBarrier(token, block, _):
                    running[token] = block
                case CancelBlock(token):
                    cancelled.append(token)
                case LeaveBarrier(token):
                    running.pop(token, None)
                case PlayEnded(ended, reason):
                    return f"{ended}: {reason}"
        if cancelled:
            token = cancelled.pop()
            running.pop(token, None)
            actions = player.on_ended(token, result("cancelled"), now_ns)
            continue
        due_ns = player.deadline_ns()
        ways = [*running, *([] if due_ns is None else [0])]
        if not ways:
            return "stuck"
        token = chance.choice(ways)
        if token == 0:
            now_ns = max(now_ns, due_ns or 0)
            actions = player.advance(now_ns)
            continue
        block = running.pop(token)
        outcomes = ["ok", "ok", *(f"error:{kind}" for kind in block.spec.errors)]
        actions = player.on_ended(token, result(chance.choice(outcomes)), now_ns)
    return "goes on"


def wrong(end: str) -> bool:
    """What the check is there to exclude; a mission may fail by an error that it does not handle."""
    return end == "stuck" or "entered again" in end or "livelock" in end


@pytest.mark.parametrize("part", range(4))
def test_sound_mission_never_gets_stuck_nor_doubles_token(part: int) -> None:
    seen: Counter[str] = Counter()
    for seed in range(part * 150, part * 150 + 150):
        text = Author(seed).mission()
        reading, findings = check_text(text, "m.json", Binding())
        assert reading.mission is not None
        assert not any(finding.rule == "too-large" for finding in findings), seed
        # a block that nobody leads to is refused, too, but hurts nobody
        verdict = sound(finding for finding in findings if finding.rule != "dead-block")
        ends = [play(reading.mission, Random(f"{seed} {throw}")) for throw in range(12)]
        bad = [end for end in ends if wrong(end)]
        assert not (verdict and bad), f"seed {seed}: sound, but {bad[0]}: {text}"
        seen["sound" if verdict else "refused"] += 1
        seen["confirmed"] += bool(bad)
    # both verdicts are there, and plays confirm refusals: the test would say nothing otherwise
    assert seen["sound"] > 40
    assert seen["confirmed"] > 10
