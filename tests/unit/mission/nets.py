"""Missions in short form, for tests."""

import json
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
