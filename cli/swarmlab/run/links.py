"""Links of a lab's radio as an operator changes and reads them."""

from collections.abc import Sequence
from itertools import permutations, product
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.session import labs
from swarmctl.session.labs import LabNode, LabState
from swarmctl.terminal.output import Output
from swarmctl.terminal.quantities import bit_s, span_s
from swarmctl.terminal.table import Detail, rows_of
from swarmlab.radio import orders
from swarmlab.radio.core.link import DELAY_MAX_S, RATE_MAX_BIT_S, Impairment, ImpairmentChange
from swarmlab.radio.core.network import LinkReport
from swarmlab.radio.orders import CutLinks, HealLinks, ImpairLinks, Links, RadioOrder, ReadLinks
from swarmware.errors import InvalidInput, OutOfRange
from swarmware.model.names import platform_of

_UNLIMITED: Final = "auto"


class RadioLinks(msgspec.Struct, frozen=True):
    """Directions of links of a lab's radio."""

    lab: str
    links: list[LinkReport]


_DETAILS: Final[list[Detail[LinkReport]]] = [
    Detail("FROM", value=lambda link: link.sender),
    Detail("TO", value=lambda link: link.receiver),
    Detail("STATE", value=lambda link: link.state),
    Detail("DISTANCE", value=lambda link: f"{link.distance_m:.0f} m", right=True),
    Detail(
        "RATE",
        value=lambda link: f"{link.rate_bit_s / 1e6:.1f} Mbit/s" if link.rate_bit_s else "wire",
        right=True,
        drop=3,
    ),
    Detail("LOSS", value=lambda link: f"{link.radio_loss_ratio * 100:.0f} %", right=True, drop=2),
    Detail("SET", value=lambda link: _set(link.impairment), wraps=True),
    Detail("FRAMES", value=lambda link: link.frames, right=True),
    Detail("LOST", value=lambda link: link.lost, right=True),
    Detail("DROPPED", value=lambda link: link.dropped, right=True, drop=1),
    Detail("CUT", value=lambda link: link.cut, right=True),
    Detail("QUEUED", value=lambda link: f"{link.queued_bytes} B", right=True, drop=4),
    Detail("DELAY", value=lambda link: f"{link.delay_s * 1000:.1f} ms", right=True),
]


def change(loss: str | None, delay: str | None, jitter: str | None, rate: str | None) -> ImpairmentChange:
    """The change that the options of `lab link` state.

    Raises: InvalidInput, OutOfRange for an option that is invalid.
    """
    return ImpairmentChange(
        loss_ratio=None if loss is None else _loss_ratio(loss),
        delay_s=None if delay is None else _delay_s("delay", delay),
        jitter_s=None if jitter is None else _delay_s("jitter", jitter),
        rate_bit_s=None if rate is None else _rate_bit_s(rate),
    )


def _loss_ratio(text: str) -> float:
    try:
        percent = float(text.removesuffix("%"))
    except ValueError:
        raise InvalidInput(f"loss {text!r}: expected a percentage, such as 30") from None
    if not 0 <= percent <= 100:
        raise OutOfRange(f"loss {text}: expected 0 to 100 percent")
    return percent / 100


def _delay_s(name: str, text: str) -> float:
    found_s = span_s(text)
    if found_s > DELAY_MAX_S:
        raise OutOfRange(f"{name} {text}: expected at most {DELAY_MAX_S:g}s")
    return found_s


def _rate_bit_s(text: str) -> float:
    """0 for `auto`, no limit."""
    if text.lower() == _UNLIMITED:
        return 0.0
    try:
        found_bit_s = float(bit_s(text))
    except InvalidInput:
        raise InvalidInput(f"rate {text!r}: expected 1mbit, 250kbit or {_UNLIMITED}") from None
    if found_bit_s > RATE_MAX_BIT_S:
        raise OutOfRange(f"rate {text}: expected at most {RATE_MAX_BIT_S / 1e9:g}gbit")
    return found_bit_s


def impair(one: str, other: str, change: ImpairmentChange, out: Output, *, one_way: bool) -> None:
    """Runs `lab link`: changes the impairments of links, or only shows them.

    Raises: NotFound for an unknown node, NoAnswer when the radio does not run.
    """
    lab = _lab(out)
    links = _between(lab, one, other, one_way=one_way)
    _order(lab, ReadLinks(links) if change.is_empty else ImpairLinks(links, change), out)


def cut(one: str, other: str, out: Output, *, one_way: bool) -> None:
    """Runs `lab cut`. Raises: as `impair`."""
    lab = _lab(out)
    _order(lab, CutLinks(_between(lab, one, other, one_way=one_way)), out)


def heal(one: str, other: str, out: Output) -> None:
    """Runs `lab heal` for all links, the links of a node, or between two. Raises: as `impair`."""
    lab = _lab(out)
    _order(lab, HealLinks(_between(lab, one, other)), out)


def partition(groups: Sequence[str], out: Output) -> None:
    """Runs `lab partition`: cuts the links between the groups; nodes that are not named are one more.

    Raises: InvalidInput when a node is in two groups or all are in one, and as `impair`.
    """
    lab = _lab(out)
    group_of: dict[str, int] = {}
    for number, group in enumerate(groups, 1):
        for node in _nodes(lab, group):
            # a node in two groups would keep links to both, so the swarm would not be divided
            if group_of.setdefault(node, number) != number:
                raise InvalidInput(f"node {node}: is in two groups; expected each in one")
    names = [node.platform for node in lab.nodes]
    apart = tuple((a, b) for a, b in permutations(names, 2) if group_of.get(a, 0) != group_of.get(b, 0))
    if not apart:
        raise InvalidInput(f"groups {' '.join(groups)}: all nodes are in one; expected two groups or more")
    # a shell makes four words of {a,b} {c,d}: the operator sees which groups were meant
    numbers = [*range(1, len(groups) + 1), 0]
    members = [[name for name in names if group_of.get(name, 0) == number] for number in numbers]
    out.say(f"groups: {' | '.join(','.join(group) for group in members if group)}")
    _order(lab, CutLinks(apart), out)


def _lab(out: Output) -> LabState:
    lab = labs.find(out.settings.lab)
    if not lab.radio_file:
        raise InvalidInput(
            f"lab {lab.name}: --net {lab.net} has no radio; expected a lab started with --net netns"
        )
    return lab


def _nodes(lab: LabState, selection: str) -> list[str]:
    """Names of the selected nodes; all computers of a platform by its name."""
    chosen: list[LabNode] = lab.select(selection)
    platforms = {node.platform for node in chosen}
    return [node.platform for node in lab.nodes if node in chosen or platform_of(node.platform) in platforms]


def _between(lab: LabState, one: str, other: str, *, one_way: bool = False) -> Links:
    """Directions between the nodes of two selections; of an empty one all nodes."""
    senders, receivers = _nodes(lab, one), _nodes(lab, other)
    forth = [(a, b) for a, b in product(senders, receivers) if a != b]
    if not forth:
        raise InvalidInput(f"link {one} {other}: expected two different nodes")
    back = [] if one_way else [(b, a) for a, b in forth]
    # two overlapping selections name a direction twice
    return tuple(dict.fromkeys([*forth, *back]))


def _order(lab: LabState, order: RadioOrder, out: Output) -> None:
    links = orders.send(Path(lab.folder), order)
    if out.settings.structured:
        out.document(RadioLinks(lab.name, links))
        return
    out.table(_DETAILS, rows_of(_DETAILS, links), empty="no links")


def _set(impairment: Impairment) -> str:
    """What an operator has set, as it is typed."""
    words = []
    if impairment.loss_ratio:
        words.append(f"loss {impairment.loss_ratio * 100:g} %")
    if impairment.delay_s:
        words.append(f"delay {impairment.delay_s * 1000:g} ms")
    if impairment.jitter_s:
        words.append(f"jitter {impairment.jitter_s * 1000:g} ms")
    if impairment.rate_bit_s:
        words.append(f"rate {impairment.rate_bit_s / 1e6:g} Mbit/s")
    return ", ".join(words)
