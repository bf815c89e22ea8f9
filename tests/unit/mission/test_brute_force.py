"""The check held against a second model: all orders of all tokens, without nets, bits or reduction."""

import json
from collections import Counter
from itertools import product
from random import Random
from typing import Any

from tests.simulation.seeds import examples
from tests.unit.mission.nets import choice, net
from tests.unit.mission.results import findings

from swarmware.mission import instants
from swarmware.mission.binding import Binding
from swarmware.mission.check import check_text
from swarmware.mission.finding import sound

Place = tuple[str, str]
"""A token: its block, and for a Join the block from which it came."""
State = frozenset[Place]
HERE = Binding()
JUDGED = {"deadlock", "dead-block", "never-ends", "two-tokens"}
END: State = frozenset()


def scribble(chance: Random) -> str:
    """A few blocks that lead anywhere, or parts in parts of which one edge was changed."""
    names = [f"b{n}" for n in range(chance.randint(1, 6))]
    targets = [*names, "e"]
    blocks: dict[str, Any] = {"s": f"Start>{chance.choice(targets)}", "e": "End"}
    for name in names:
        kind = chance.choice(["Wait", "Wait", "Fork", "Fork", "Join", "choice"])
        if kind == "choice":
            blocks[name] = choice(chance.choice(targets), chance.choice(targets))
        elif kind == "Fork":
            blocks[name] = "Fork>" + ",".join(chance.sample(targets, chance.randint(1, min(3, len(targets)))))
        else:
            blocks[name] = f"{kind}>{chance.choice(targets)}"
    return net(**blocks)


def arranged(chance: Random) -> str:
    """Parts in parts, of which one edge may be changed."""
    blocks: dict[str, Any] = {"e": "End"}

    def part(depth: int, after: str) -> str:
        name = f"b{len(blocks)}"
        kind = chance.randrange(5) if depth else 0
        blocks[name] = f"Wait>{after}"
        if kind == 1:
            return part(depth - 1, part(depth - 1, after))
        if kind in {2, 3}:
            blocks[name] = f"Join>{after}"
            heads = {part(depth - 1, name): None for _ in range(2)}
            if chance.random() < 0.2:
                heads["e"] = None
            blocks[f"f{name}"] = "Fork>" + ",".join(heads)
            return f"f{name}"
        if kind == 4:
            blocks[name] = choice(part(depth - 1, after), part(depth - 1, name) if depth > 1 else after)
        return name

    blocks["s"] = f"Start>{part(2, 'e')}"
    if chance.random() < 0.6:
        victim = chance.choice(
            [name for name, block in blocks.items() if isinstance(block, str) and ">" in block]
        )
        kind, _, after = blocks[victim].partition(">")
        heads = after.split(",")
        heads[chance.randrange(len(heads))] = chance.choice([name for name in blocks if name != "s"])
        blocks[victim] = f"{kind}>{','.join(dict.fromkeys(heads))}"
    return net(**blocks)


class Model:
    """All states of a mission, and whether something is wrong in one of them."""

    def __init__(self, text: str) -> None:
        self._blocks: dict[str, Any] = json.loads(text)["mission"]
        self._sources = {
            name: frozenset((name, source) for source in self._blocks if name in self._targets(source))
            for name, block in self._blocks.items()
            if block["type"] == "Join"
        }
        self._entered: set[str] = set()
        self._after: dict[State, set[State]] = {}
        self._wrong = False

    def is_wrong(self) -> bool:
        first = frozenset({("s", "")})
        work = [first]
        while work:
            state = work.pop()
            if state in self._after:
                continue
            self._after[state] = set(self._steps(state)) if state else set()
            work += self._after[state]
        ending = {END}
        while more := {state for state, after in self._after.items() if after & ending} - ending:
            ending |= more
        return self._wrong or set(self._after) - ending != set() or set(self._blocks) != self._entered

    def _targets(self, name: str) -> list[str]:
        block = self._blocks[name]
        if "nextIfTrue" in block:
            return [block["nextIfTrue"], block["nextIfFalse"]]
        after = block.get("next", [])
        return after if isinstance(after, list) else [after]

    def _steps(self, state: State) -> list[State]:
        for takes_time in (False, True):
            found: list[State] = []
            for place in sorted(state):
                name = place[0]
                kind = self._blocks[name]["type"]
                if kind == "End" or (kind == "Wait") is not takes_time:
                    self._entered |= {name} if kind in {"End", "Wait"} else set()
                    continue
                used = self._sources.get(name, frozenset({place}))
                if used <= state:
                    self._entered.add(name)
                    heads = self._targets(name)
                    ways = [heads] if kind == "Fork" else [[head] for head in heads]
                    moved = [self._moved(state - used, name, way) for way in ways]
                    found += [after for after in moved if after is not None]
            if found:
                return found
            if any(self._blocks[name]["type"] == "End" for name, _ in state):
                return [END]
        return []

    def _moved(self, rest: State, source: str, heads: list[str]) -> State | None:
        new = [(head, source if self._blocks[head]["type"] == "Join" else "") for head in heads]
        twice = {self._blocks[place[0]]["type"] for place in new if place in rest}
        self._wrong |= bool(twice & {"Wait", "Join"})
        # a block that takes no time is left before the second token comes, so this order is impossible
        return rest | frozenset(new) if twice <= {"Wait", "Join", "End"} else None


def test_check_and_model_of_all_orders_agree() -> None:
    seen: Counter[str] = Counter()
    for seed in range(examples(600, 6_000)):
        chance = Random(seed)
        text = arranged(chance) if seed % 2 else scribble(chance)
        reading, findings = check_text(text, "m.json", HERE)
        others = [finding for finding in findings if finding.rule not in JUDGED | {"cut-short"}]
        if reading.mission is None or others or instants.check(reading.mission):
            continue
        wrong = Model(text).is_wrong()
        assert sound(findings) != wrong, f"seed {seed}: {text}\n" + "\n".join(map(str, findings))
        seen["wrong" if wrong else "sound"] += 1
        seen.update({finding.rule for finding in findings})
    assert min(seen["sound"], seen["wrong"]) > 50
    assert {*JUDGED, "cut-short"} <= set(seen)


# -- several roles


Line = tuple[str, ...]
"""Ids of the barriers on one path of a role, in order."""


def lines_of(chance: Random, ids: str) -> list[Line]:
    """The paths of a role, between which it chooses; each role has every id on some path."""
    first = [chance.choice(ids) for _ in range(chance.randint(1, 3))] + list(ids)
    chance.shuffle(first)
    others = [tuple(chance.choices(ids, k=chance.randint(0, 3))) for _ in range(chance.choice([0, 0, 1, 2]))]
    return [tuple(first), *others]


def of_lines(lines: list[Line]) -> str:
    """A mission with these paths."""
    blocks: dict[str, Any] = {"e": "End"}
    for number, line in enumerate(lines):
        for place, barrier in enumerate(line):
            after = f"m{number}_{place + 1}" if place + 1 < len(line) else "e"
            blocks[f"m{number}_{place}"] = {"type": "Barrier", "id": barrier, "next": after}
        head = f"m{number}_0" if line else "e"
        blocks[f"d{number}"] = choice(head, f"d{number + 1}") if number + 1 < len(lines) else f"Wait>{head}"
    return net(s="Start>d0", **blocks)


def outcome(lines: tuple[Line, ...]) -> str:
    """What happens when each role follows one path: all are done, one fails, or some wait for ever."""
    at = [0] * len(lines)
    failed: set[int] = set()
    while True:
        ended = {role for role, line in enumerate(lines) if at[role] == len(line)} | failed
        waiting = {
            role: (line[at[role]], line[: at[role]].count(line[at[role]]))
            for role, line in enumerate(lines)
            if role not in ended
        }
        if not waiting:
            return "fails" if failed else "done"
        if len(waiting) == len(lines) and len(set(waiting.values())) == 1:
            at = [place + 1 for place in at]
        elif ended:
            failed |= set(waiting)  # a member that has ended breaks every barrier
        else:
            return "hangs"


def test_check_agrees_with_model_of_all_paths() -> None:
    seen: Counter[str] = Counter()
    for seed in range(examples(500, 5_000)):
        chance = Random(f"roles {seed}")
        ids = "xyz"[: chance.choice([1, 1, 2, 3])]
        roles = [lines_of(chance, ids) for _ in range(chance.randint(2, 3))]
        if chance.random() < 0.5:
            roles = [roles[0]] * len(roles)
        wanted = {outcome(lines) for lines in product(*roles)}
        found = [f for f in findings(*map(of_lines, roles)) if f.rule in {"barrier", "unequal-visits"}]
        if "hangs" in wanted:
            expected = [("error", "barrier")]
        elif "fails" in wanted:
            expected = [("warning" if "done" in wanted else "error", "unequal-visits")]
        else:
            expected = []
        assert [(f.severity, f.rule) for f in found] == expected, (seed, roles, wanted)
        seen.update(["/".join(entry) for entry in expected] or ["sound"])
    assert min(seen.values()) > 20
    assert len(seen) == 4
