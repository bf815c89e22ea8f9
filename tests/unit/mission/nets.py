"""Missions in short form, for tests."""

import json
from collections.abc import Callable
from random import Random
from typing import Any


def net(**blocks: Any) -> str:
    """Blocks by short form: "Type>next", "Fork>a,b", or a dict."""
    full: dict[str, Any] = {}
    for name, block in blocks.items():
        if isinstance(block, str):
            kind, _, targets = block.partition(">")
            body: dict[str, Any] = {"type": kind}
            if targets:
                body["next"] = targets.split(",") if kind == "Fork" else targets
            if kind == "Wait":
                body["s"] = 1
            full[name] = body
        else:
            full[name] = block
    return json.dumps({"mission": full})


def choice(a: str, b: str) -> dict[str, Any]:
    return {"type": "DecisionRandom", "chanceForTrue": 0.5, "nextIfTrue": a, "nextIfFalse": b}


def wide(branches: int, body: Callable[[int], dict[str, Any]]) -> str:
    """Parallel branches from one Fork to one Join `j`; branch n begins with the first block of `body(n)`."""
    bodies = [body(n) for n in range(branches)]
    heads = ",".join(next(iter(part)) for part in bodies)
    blocks = {name: block for part in bodies for name, block in part.items()}
    return net(s="Start>f", f=f"Fork>{heads}", **blocks, j="Join>e", e="End")


def lattice(width: int, rows: int) -> str:
    """Each branch joins with its neighbours in every row: sound, and no branch is like another."""
    blocks: dict[str, Any] = {}
    for row in range(rows):
        for n in range(width):
            after = f"a{row + 1}_{n}" if row < rows - 1 else "j"
            blocks |= {
                f"a{row}_{n}": f"Wait>f{row}_{n}",
                f"f{row}_{n}": f"Fork>l{row}_{n},r{row}_{n}",
                f"l{row}_{n}": f"Wait>j{row}_{n}",
                f"r{row}_{n}": f"Wait>j{row}_{(n + 1) % width}",
                f"j{row}_{n}": f"Join>{after}",
            }
    heads = ",".join(f"a0_{n}" for n in range(width))
    return net(s="Start>f", f=f"Fork>{heads}", **blocks, j="Join>e", e="End")


def tangle(chance: Random) -> str:
    """A few blocks of any type that lead anywhere."""
    names = [f"b{n}" for n in range(chance.randint(3, 11))] + ["e", "e2"]
    chance.shuffle(names)
    more: dict[str, dict[str, Any]] = {"Goto": {"x": 1, "y": 1}, "Takeoff": {"alt": 3}}
    blocks: dict[str, Any] = {"s": f"Start>{chance.choice(names)}"}
    kinds = ["Wait", "Wait", "Wait", "Fork", "Fork", "Join", "Join", "choice", "choice"]
    kinds += ["Arm", "Goto", "Takeoff", "Land", "Barrier"]
    for name in names:
        kind = chance.choice(kinds)
        after, other = chance.choice(names), chance.choice(names)
        if name in {"e", "e2"}:
            blocks[name] = {"type": "End", "result": chance.choice(["done", "failed"])}
        elif kind == "choice":
            blocks[name] = choice(after, other)
        elif kind == "Fork":
            blocks[name] = "Fork>" + ",".join(chance.sample(names, chance.randint(1, 3)))
        elif kind in {"Wait", "Join"}:
            blocks[name] = f"{kind}>{after}"
        else:
            blocks[name] = {"type": kind, "next": after, **more.get(kind, {})}
            if kind == "Barrier":
                blocks[name]["id"] = name
            if chance.random() < 0.5:
                blocks[name]["nextError"] = other
            if chance.random() < 0.3:
                blocks[name] |= {"nextTimeout": chance.choice(names), "timeout_s": 5}
    return net(**blocks)
