"""The chart of a mission: a row of blocks for each member, barriers as vertical lines."""

from typing import Final

from swarmlab.measure.mission_timeline import READY, RECOVERY, BarrierPassage, BlockSpan
from swarmlab.report import labels
from swarmlab.report.plot_data import PlotData
from swarmlab.report.scale import Scale
from swarmlab.report.svg import LEFT, RIGHT, SIZE, document, element, line, text, title
from swarmlab.report.time_chart import time_axis
from swarmware.types.mission import MissionPhase

ROW_PX: Final = 20.0
HEAD_PX: Final = 46.0
COLOURS: Final = 7
"""Number of colours for the types of blocks (`.block-0` … in the style sheet)."""
WAITS: Final = frozenset({"Barrier", "Wait"})
"""Types drawn pale: the member waits."""
GOOD: Final = frozenset({"ok", ""})
_NAMES: Final = {READY: "ready", RECOVERY: "recovery"}


def timeline(data: PlotData) -> str:
    """The blocks of each member over time, and the instants at which barriers opened."""
    times = Scale(0.0, max(data.duration_s, 1.0), LEFT, RIGHT)
    bottom = HEAD_PX + ROW_PX * max(1, len(data.timelines))
    colours = block_colours(data)
    parts = [time_axis(times, HEAD_PX, bottom)]
    for row, (name, member) in enumerate(data.timelines.items()):
        top = HEAD_PX + ROW_PX * row
        parts.append(text(name, LEFT - 6, top + 14, f"name {data.kinds.get(name, '')}", "end"))
        height = (ROW_PX - 4) / member.lanes
        parts += [_span(span, name, times, top + 2, height, colours) for span in member.spans]
        if member.outcome is not None:
            kind = "outcome" if member.outcome is MissionPhase.DONE else "outcome failed"
            parts.append(text(member.outcome, RIGHT + 8, top + 14, kind))
    parts += _barriers(data.barriers, times, bottom)
    return document(
        "Mission timeline",
        f"The blocks of {len(data.timelines)} members over time, {len(data.barriers)} barriers as lines.",
        bottom + 40,
        parts,
        {
            "class": "chart time",
            "data-t": f"{times.low:g} {times.high:g}",
            "data-x": f"{LEFT:g} {RIGHT:g}",
            "data-top": f"{HEAD_PX:g}",
        },
    )


def block_colours(data: PlotData) -> dict[str, str]:
    """CSS class of each type of block, in the order of the first occurrence."""
    types = dict.fromkeys(
        span.type
        for member in data.timelines.values()
        for span in member.spans
        if span.type and span.type not in WAITS
    )
    return {name: f"block-{i % COLOURS}" for i, name in enumerate(types)}


def legend(data: PlotData) -> list[tuple[str, str]]:
    """CSS class and meaning of each colour."""
    waiting = any(span.type in WAITS for member in data.timelines.values() for span in member.spans)
    known = [(kind, name) for name, kind in block_colours(data).items()]
    return [*known, *([("waits", "waits at a barrier")] if waiting else [])]


def _span(
    span: BlockSpan, platform: str, times: Scale, top: float, height: float, colours: dict[str, str]
) -> str:
    x1, x2 = times.px(span.start_s), times.px(span.end_s)
    name = _NAMES.get(span.block, span.block)
    kind = "waits" if span.type in WAITS or not span.type else colours[span.type]
    if span.outcome not in GOOD:
        kind += " failed"
    ended = span.outcome or ("not ended" if span.type else "")
    of_type = f" ({span.type})" if span.type else ""
    words = [f"{platform}: {name}{of_type}, {span.start_s:.2f}–{span.end_s:.2f} s", ended, span.text]
    tip = ", ".join(word for word in words if word)
    # A block of an instant would have no width: the least width keeps it visible.
    box = {
        "x": x1, "y": top + span.lane * height, "width": max(x2 - x1, 0.8), "height": height - 0.5,
        "class": f"block {kind}",
    }  # fmt: skip
    shown = element("rect", box, title(tip))
    if labels.width(name, SIZE - 1) + 6 < x2 - x1 and height > 10:
        shown += text(name, (x1 + x2) / 2, top + span.lane * height + height - 4, "blockname", "middle")
    return shown


def _barriers(found: tuple[BarrierPassage, ...], times: Scale, bottom: float) -> list[str]:
    """Vertical lines, with their names above in two rows where they are close."""
    parts = []
    ends = [float("-inf"), float("-inf"), float("-inf")]
    for passage in found:
        x = times.px(passage.at_s)
        tip = passage_text(passage)
        name = passage_name(passage)
        wide = labels.width(name, SIZE)
        row = next((i for i, end in enumerate(ends) if end + 6 <= x - wide / 2), None)
        kind = "barrier broken" if passage.broken else "barrier"
        start = HEAD_PX - 4 if row is None else 15.0 + 13 * row
        parts.append(line(x, start, x, bottom, kind, title(tip)))
        if row is not None:
            ends[row] = x + wide / 2
            parts.append(text(name, x, 12.0 + 13 * row, "barriername", "middle"))
    return parts


def passage_name(passage: BarrierPassage) -> str:
    """Name of a barrier, with the number of the visit from the second on."""
    name = passage.barrier.removeprefix("@")
    return name if passage.visit == 1 else f"{name} ({passage.visit})"


def passage_text(passage: BarrierPassage) -> str:
    """A barrier as a sentence."""
    name = passage_name(passage)
    if passage.broken:
        return f"barrier {name}: did not open; known after {passage.at_s:.2f} s"
    spread_ms = passage.spread_s * 1000
    return (
        f"barrier {name}: opened after {passage.at_s:.3f} s for {passage.members} members, "
        f"{spread_ms:.1f} ms apart"
    )
