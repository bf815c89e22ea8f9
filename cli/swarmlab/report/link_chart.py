"""Links between nodes as a matrix: loss and round-trip time of each direction."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import msgspec

from swarmlab.report.plot_data import ObservedLink, PlotData
from swarmlab.report.scale import label
from swarmlab.report.svg import document, element, rectangle, text, title

EQUAL_LOSS: Final = 0.005
"""Losses that differ less are equal: one datagram of 200."""
EQUAL_RTT_MS: Final = 1.0
"""Round-trip times that differ less are equal: on one host the scheduler causes such differences."""
LOSS_LIMITS: Final = (0.001, 0.01, 0.05, 0.2)
"""Upper ends of the classes of loss but the last."""
RTT_LIMITS_MS: Final = (1.0, 3.0, 10.0, 50.0)
LEFT: Final = 62.0
TOP: Final = 66.0
SIDE: Final = 360.0
STRIDE: Final = 480.0


class LinkSummary(msgspec.Struct, frozen=True):
    """What all links have in common, and whether a matrix shows more than that."""

    text: str
    show_loss: bool
    show_rtt: bool


def summary(data: PlotData) -> LinkSummary:
    """The links in one or two sentences."""
    found = data.neighbours
    possible = len(data.nodes) * (len(data.nodes) - 1)
    if not found:
        return LinkSummary("No link was recorded.", show_loss=False, show_rtt=False)
    losses = [1 - link.quality for link in found]
    rtts = [link.rtt_ms for link in found if link.rtt_ms is not None]
    words = [f"{len(found)} of {possible} directions between {len(data.nodes)} nodes had traffic."]
    same_loss = max(losses) - min(losses) < EQUAL_LOSS
    words.append(
        f"Loss is {'equal on all of them' if same_loss else 'different'}: {_range(losses, 100, '%')}."
    )
    same_rtt = not rtts or max(rtts) - min(rtts) < EQUAL_RTT_MS
    if rtts:
        how = f"differ by less than {EQUAL_RTT_MS:g} ms" if same_rtt else "differ"
        words.append(f"Round-trip times {how}: {_range(rtts, 1, 'ms')}.")
    if data.unaccepted:
        words.append(
            f"{data.unaccepted} datagrams belong to no link: their sender was not accepted,"
            " as at the start of every session."
        )
    # a direction without traffic is a difference that equal figures do not show
    missing = len(found) < possible
    return LinkSummary(" ".join(words), not same_loss or missing, not same_rtt)


def _range(values: Sequence[float], factor: float, unit: str) -> str:
    low, high = (label(_rounded(limit * factor)) for limit in (min(values), max(values)))
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def _rounded(value: float) -> float:
    """Two decimals, and of less than 0.1 two digits: a short time is not none."""
    return round(value, 2) if value >= 0.1 else float(f"{value:.2g}")


def matrices(data: PlotData) -> str:
    """The matrices that show a difference, or "" if all links are equal."""
    known = summary(data)
    links = {(link.node, link.hears): link for link in data.neighbours}
    found = []
    if known.show_loss:
        found.append(("Loss", LOSS_LIMITS, _loss, 100.0, "%"))
    if known.show_rtt:
        found.append(("Round-trip time", RTT_LIMITS_MS, _rtt, 1.0, "ms"))
    if not found:
        return ""
    parts = []
    for i, (name, limits, value, factor, unit) in enumerate(found):
        at = LEFT + STRIDE * i
        parts += _matrix(at, name, data, links, limits, value, factor, unit)
    return document(
        "Links", f"Loss and round-trip time of each direction. {known.text}", TOP + SIDE + 44, parts
    )


def _loss(link: ObservedLink) -> float | None:
    return 1 - link.quality


def _rtt(link: ObservedLink) -> float | None:
    return link.rtt_ms


def level(value: float, limits: Sequence[float]) -> int:
    """Number of the class of a value; 0 is the best."""
    return sum(value >= limit for limit in limits)


def _matrix(
    at: float,
    name: str,
    data: PlotData,
    links: Mapping[tuple[str, str], ObservedLink],
    limits: Sequence[float],
    value: Callable[[ObservedLink], float | None],
    factor: float,
    unit: str,
) -> list[str]:
    nodes = [node.platform for node in data.nodes]
    cell = SIDE / len(nodes)
    parts = [
        text(f"{name}, {unit}", at, 14.0, "legend strong"),
        text("row: receiver, column: sender", at, 30.0, "legend"),
    ]
    # with small cells not every name has room
    every = max(1, round(11.0 / cell + 0.49))
    for i, node in enumerate(nodes):
        if i % every:
            continue
        middle = cell * (i + 0.5)
        x, y = at + middle + 4, TOP - 6
        parts += [
            text(node, at - 5, TOP + middle + 4, "tick", "end"),
            text(node, x, y, "tick", transform=f"rotate(-60 {x:.1f} {y:.1f})"),
        ]
    for row, receiver in enumerate(nodes):
        for column, sender in enumerate(nodes):
            if receiver == sender:
                continue
            link = links.get((receiver, sender))
            found = None if link is None else value(link)
            if found is None:
                kind, measured = "none", "no traffic" if link is None else "not measured"
            else:
                kind, measured = f"level-{level(found, limits)}", f"{found * factor:.3g} {unit}"
            tip = f"{receiver} receives from {sender}: {name.lower()} {measured}"
            parts.append(
                element(
                    "rect",
                    {
                        "x": at + cell * column, "y": TOP + cell * row, "width": cell - 1, "height": cell - 1,
                        "class": f"cell {kind}",
                    },
                    title(tip),
                )
            )  # fmt: skip
    x = at
    shown = [f"< {limit * factor:g}" for limit in limits] + [f"≥ {limits[-1] * factor:g}", "none"]
    for number, words in enumerate(shown):
        kind = "none" if words == "none" else f"level-{number}"
        parts += [
            rectangle(x, TOP + SIDE + 14, 12, 12, f"cell {kind}"),
            text(words, x + 16, TOP + SIDE + 24, "tick"),
        ]
        x += 62
    return parts
