"""Reduces a net to a smaller one with the same errors: branches that only take time become one place.

The rules merge a place into its successor, or into an equal place on another branch, where this does not
change the behaviour of the rest of the net; so a fork of two hundred pauses has a few states instead of
2^200. They preserve deadlocks, paths to an End, second tokens, blocks that are never entered, and all states
of the blocks `kept`.
Source: Murata, Petri nets: properties, analysis and applications (1989), section VI: fusion of series and of
parallel places and transitions, elimination of self-loops; here with blocks that take no time and Ends that
clear the net.
"""

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable
from itertools import islice
from typing import Final

import msgspec

from swarmware.mission.budget import Budget
from swarmware.mission.net import Net, Transition
from swarmware.mission.outcome import SUCCESS

_COST: Final = 200
_COST_OF_OUTPUT: Final = 4
"""Budget of a rewritten transition, in bytes: accounts for its time, not for its memory."""

LOOP_LIMIT: Final = 32
"""Maximum places for the search of loops; a sequence of blocks is one place by then."""


def reduce(
    net: Net,
    kept: Collection[str],
    budget: Budget,
    kind: Callable[[str], str] = lambda _: "",
) -> Net:
    """Reduce a net without changing the results of the checks.

    `kept`: blocks whose states are all preserved. `kind`: kind of an End block; two Ends of one kind are
    equal.
    """
    return _Reducer(net, frozenset(kept), budget, kind).net()


class _Reducer:
    """Applies the rules until none matches."""

    def __init__(self, net: Net, kept: frozenset[str], budget: Budget, kind: Callable[[str], str]) -> None:
        self._net = net
        self._budget = budget
        self._kept = {place for place, block in net.owner.items() if block in kept}
        self._end_kind = {place: kind(net.owner[place]) for place in net.ends()}
        self._instant = set(net.instant)
        self._within: dict[str, frozenset[str]] = dict(net.within)
        self._all = dict(enumerate(_reachable(net)))
        self._next = len(self._all)
        self._into: dict[str, set[int]] = {place: set() for place in net.owner}
        self._from: dict[str, set[int]] = {place: set() for place in net.owner}
        for number, transition in self._all.items():
            self._link(number, transition)
        self._gone: set[str] = set()
        self._queue = deque(net.owner)
        self._queued = set(net.owner)
        self._joins: set[int] = set()
        """Joins whose branches are compared when no place is queued: each comparison reads all of them."""
        self._doubled: dict[int, tuple[tuple[str, ...], frozenset[str]]] = {}

    def net(self) -> Net:
        while (self._queue or self._joins) and not self._budget.spent:
            if not self._queue:
                # The lowest number, so that one mission always gives the same net.
                number = min(self._joins)
                self._joins.discard(number)
                if number in self._all:
                    self._twins(number)
                continue
            place = self._queue.popleft()
            self._queued.discard(place)
            if place not in self._gone:
                self._look(place)
        return Net(
            self._net.start,
            tuple(self._all.values()),
            {place: block for place, block in self._net.owner.items() if place not in self._gone},
            frozenset(self._instant - self._gone),
            {place: blocks for place, blocks in self._within.items() if place not in self._gone},
        )

    # -- the rules

    def _look(self, place: str) -> None:
        """Applies the first rule that matches this place."""
        if place in self._end_kind or place in self._kept or not self._from[place]:
            return
        self._unite(place)
        inputs = {t.inputs for t in self._after(place)}
        if len(inputs) > 1 or len(next(iter(inputs))) > 1:
            self._joins.add(next(iter(self._from[place])))
        elif place == self._net.start or (len(self._from[place]) > 1 and self._loop(place)):
            return
        elif place in self._instant:
            self._absorb(place)
        else:
            self._series(place)

    def _unite(self, place: str) -> None:
        """Merges equal transitions; removes a self-loop if there is another transition."""
        seen: dict[tuple[str, ...], int] = {}
        loops: list[int] = []
        for number in sorted(self._from[place]):
            transition = self._all[number]
            # a Join: its branches are compared by another rule
            if transition.inputs != {place}:
                return
            key = tuple(sorted(transition.outputs))
            if key == (place,) and place not in self._instant:
                loops.append(number)
            elif key in seen:
                self._hide(seen[key], self._passed(transition))
                self._drop(number)
            else:
                seen[key] = number
        # without another transition one loop stays, or the place would look like a deadlock
        for number in loops if seen else loops[1:]:
            self._enclose(place, self._passed(self._all[number]))
            self._drop(number)

    def _absorb(self, place: str) -> None:
        """Merges an instantaneous place into the transitions that lead to it."""
        before, after = self._before(place), self._after(place)
        several = len(after) > 1
        # a product of transitions would make the net larger, not smaller
        if not before or (several and len(before) * len(after) > len(before) + len(after)):
            return
        if any(place in t.outputs for t in after) or any(t.outputs.count(place) > 1 for t in before):
            return
        if several and any(t.inputs & self._kept or len(t.inputs) > 1 for t in before):
            return  # a kept block keeps its outcomes, a Join has one
        numbers = self._into[place] | self._from[place]
        # made before any is dropped: they read the transitions that go
        made = [self._joined(first, place, second) for first in before for second in after]
        for number in numbers:
            self._drop(number)
        for transition in made:
            self._add(transition)
        self._remove(place)

    def _joined(self, first: Transition, place: str, second: Transition) -> Transition:
        outputs = list(first.outputs)
        at = outputs.index(place)
        outputs[at : at + 1] = second.outputs
        return msgspec.structs.replace(
            first,
            outputs=tuple(outputs) if second.outputs else (),
            path=(*first.path, second.label, *second.path),
            passes=first.passes | self._passed(second),
        )

    def _loop(self, place: str) -> bool:
        """Merges a strongly connected set of places, one of which takes time, into one place."""
        members = self._circle(place)
        # a loop without a pause is an error of its own, which must stay visible
        if len(members) < 2 or members <= self._instant or self._ends_at_once(*members):
            return False
        exits: list[Transition] = []
        for member in members:
            for number in list(self._from[member]):
                transition = self._all[number]
                self._enclose(place, self._passed(transition))
                if len(transition.outputs) != 1 or transition.outputs[0] not in members:
                    exits.append(transition)
                self._drop(number)
        for transition in exits:
            self._add(msgspec.structs.replace(transition, inputs=frozenset({place})))
        for member in members - {place}:
            self._enclose(place, self._within.get(member, ()))
            self._redirect(member, place)
        # a loop without an exit stays a livelock in the smaller net
        if not exits:
            self._add(Transition(self._net.owner[place], SUCCESS, frozenset({place}), (place,)))
        self._slow((place,))
        return True

    def _circle(self, place: str) -> set[str]:
        """Places from which there are paths to this one and back."""
        seen, work = {place}, [place]
        before: dict[str, list[str]] = {}
        while work and len(seen) <= LOOP_LIMIT:
            now = work.pop()
            for transition in self._after(now):
                for target in transition.outputs if len(transition.outputs) == 1 else ():
                    # such a place has a meaning of its own, and ends the circle
                    if target == self._net.start or target in self._kept or not self._is_plain(target):
                        continue
                    before.setdefault(target, []).append(now)
                    if target not in seen:
                        seen.add(target)
                        work.append(target)
        found, work = {place}, [place]
        while work:
            for source in before.get(work.pop(), ()):
                if source not in found:
                    found.add(source)
                    work.append(source)
        return found

    def _series(self, place: str) -> None:
        """Merges a pause into its only successor."""
        on = [t for t in self._after(place) if not self._is_end(t)]
        ends = [t for t in self._after(place) if self._is_end(t)]
        targets = {t.outputs for t in on}
        if len(targets) != 1 or len(on[0].outputs) != 1:
            return
        (target,) = on[0].outputs
        # the states of these places are part of the findings
        if target in self._kept or target in self._end_kind or target == place or not self._from[target]:
            return
        if self._ends_at_once(place):
            return
        if self._is_plain(target):
            if target in self._instant or not self._end_kinds(place) <= self._end_kinds(target):
                return
        elif ends or not self._into[target] <= self._from[place]:
            return
        else:
            join = self._all[next(iter(self._from[target]))]
            self._slow(join.inputs)  # it is not complete before the pause is over
        path = (on[0].label, *on[0].path)
        passes = self._blocks_of(place)
        for number in list(self._from[place]):
            self._drop(number)
        self._redirect(place, target, path, passes)

    def _twins(self, number: int) -> None:
        """Merges parallel branches without actions between one Fork and one Join."""
        join = self._all[number]
        self._budget.pay(_COST * len(join.inputs))
        groups: dict[frozenset[int], str] = {}
        for place in sorted(join.inputs):
            before = frozenset(self._into[place])
            if not before or any(place in self._doubles(n) for n in before):
                continue
            if place == self._net.start or before & self._from[place]:
                continue
            first = groups.setdefault(before, place)
            if first != place:
                self._forget(place, first)
                # the Join has one branch less: the next twin is compared with the rest
                join = self._narrow(number, place)
        self._waiting_twins(number)

    def _waiting_twins(self, number: int) -> None:
        """Merges parallel branches of one place each that may end the mission."""
        groups: dict[tuple[frozenset[int], frozenset[str]], tuple[str, str]] = {}
        for place in sorted(self._all[number].inputs):
            wait = self._waits_for(place)
            if wait is None:
                continue
            before = frozenset(self._into[wait])
            if not before or any(wait in self._doubles(n) for n in before):
                continue
            first = groups.setdefault((before, self._end_kinds(wait)), (wait, place))
            if first != (wait, place):
                self._enclose(first[0], self._blocks_of(wait))
                on = next(t for t in self._after(wait) if not self._is_end(t))
                self._lengthen(first[1], (on.label, *on.path))
                for other in list(self._from[wait]):
                    self._drop(other)
                self._forget(wait, first[0])
                self._forget(place, first[1])
                self._narrow(number, place)

    def _doubles(self, number: int) -> frozenset[str]:
        """Output places that the transition marks twice."""
        outputs = self._all[number].outputs
        known = self._doubled.get(number)
        # by identity: a rewritten transition has other outputs
        if known is None or known[0] is not outputs:
            counted = Counter(outputs)
            known = outputs, frozenset(place for place, times in counted.items() if times > 1)
            self._doubled[number] = known
        return known[1]

    def _waits_for(self, place: str) -> str | None:
        """The only place before one of a Join, if it only waits or ends the mission."""
        before = {p for n in self._into[place] for p in self._all[n].inputs}
        if len(before) != 1:
            return None
        (wait,) = before
        if wait in self._instant | self._kept or wait == self._net.start or not self._is_plain(wait):
            return None
        on = [t for t in self._after(wait) if not self._is_end(t)]
        return wait if on and all(t.outputs == (place,) for t in on) else None

    def _ends_at_once(self, *places: str) -> bool:
        """Whether an End may follow at once, so that later places may not be reached."""
        seen: set[str] = set()
        up, came = [*places], {*places}
        while up:
            for transition in self._before(up.pop()):
                self._budget.pay(_COST_OF_OUTPUT)
                seen |= self._instant.intersection(transition.outputs) - came
                sooner = self._instant.intersection(transition.inputs) - came
                came |= sooner
                up += sooner
        own = {number for place in places for number in self._from[place]}
        work = list(seen)
        while work:
            now = work.pop()
            if now in self._end_kind:
                return True
            for transition in self._after(now):
                self._budget.pay(_COST_OF_OUTPUT)
                if any(self._into[p] and self._into[p] <= own for p in transition.inputs):
                    continue  # a Join that waits for this very token
                if not transition.outputs:
                    return True
                new = self._instant.intersection(transition.outputs) - seen
                seen |= new
                work += new
        return False

    # -- the net

    def _before(self, place: str) -> list[Transition]:
        return [self._all[n] for n in sorted(self._into[place])]

    def _after(self, place: str) -> list[Transition]:
        return [self._all[n] for n in sorted(self._from[place])]

    def _is_plain(self, place: str) -> bool:
        """Whether its transitions have no other input, and it does not belong to an End."""
        after = self._after(place)
        return bool(after) and place not in self._end_kind and all(t.inputs == {place} for t in after)

    def _is_end(self, transition: Transition) -> bool:
        return not transition.outputs or (
            len(transition.outputs) == 1 and transition.outputs[0] in self._end_kind
        )

    def _end_kinds(self, place: str) -> frozenset[str]:
        ends = [t for t in self._after(place) if self._is_end(t)]
        return frozenset(self._end_kind[t.outputs[0]] if t.outputs else "" for t in ends)

    def _passed(self, transition: Transition) -> frozenset[str]:
        return transition.passes | {transition.block}

    def _blocks_of(self, place: str) -> set[str]:
        """All blocks that a token passes if the place is merged into another."""
        found = {self._net.owner[place], *self._within.get(place, ())}
        for transition in self._after(place):
            found |= self._passed(transition)
            if self._is_end(transition):
                found |= {self._net.owner[end] for end in transition.outputs}
        return found

    def _enclose(self, place: str, blocks: Iterable[str]) -> None:
        self._within[place] = self._within.get(place, frozenset()).union(blocks)

    def _hide(self, number: int, blocks: Collection[str]) -> None:
        """The transition passes these blocks, too."""
        before = self._all[number]
        self._all[number] = msgspec.structs.replace(before, passes=before.passes.union(blocks))

    def _slow(self, places: Iterable[str]) -> None:
        """Mark places in which tokens may stay."""
        for place in self._instant.intersection(places):
            self._instant.discard(place)
            self._wake(o for t in self._before(place) for o in t.outputs)

    def _forget(self, place: str, twin: str) -> None:
        """Removes a place from all transitions that lead to it; its twin represents it."""
        self._enclose(twin, self._within.get(place, ()))
        for number in self._into[place]:
            self._rewrite(number, place, ())
        self._remove(place)

    def _lengthen(self, place: str, path: tuple[str, ...]) -> None:
        """Adds a path to the transitions that lead to a place."""
        for number in self._into[place]:
            before = self._all[number]
            self._all[number] = msgspec.structs.replace(before, path=before.path + path)

    def _narrow(self, number: int, place: str) -> Transition:
        """The Join no longer waits for this place."""
        join = self._all[number]
        changed = self._all[number] = msgspec.structs.replace(join, inputs=join.inputs - {place})
        self._budget.pay(_COST)
        self._wake(islice(changed.inputs, 1))
        return changed

    def _redirect(
        self, place: str, target: str, path: tuple[str, ...] = (), passes: Collection[str] = ()
    ) -> None:
        """Redirect all transitions from one place to the other, with this path; remove the place."""
        for number in self._into[place]:
            self._rewrite(number, place, (target,), path)
            self._hide(number, passes)
        self._into[target] |= self._into[place]
        self._remove(place)
        self._wake((target,))

    def _rewrite(self, number: int, place: str, targets: tuple[str, ...], path: tuple[str, ...] = ()) -> None:
        """The transition leads to these instead of the place."""
        before = self._all[number]
        outputs = before.outputs
        while place in outputs:
            at = outputs.index(place)
            outputs = outputs[:at] + targets + outputs[at + 1 :]
        self._all[number] = msgspec.structs.replace(before, outputs=outputs, path=before.path + path)
        self._budget.pay(_COST + _COST_OF_OUTPUT * len(outputs))
        self._wake(before.inputs)

    def _add(self, transition: Transition) -> None:
        self._all[self._next] = transition
        self._link(self._next, transition)
        self._next += 1
        self._wake((*transition.inputs, *transition.outputs))

    def _drop(self, number: int) -> None:
        transition = self._all[number]
        self._unlink(number)
        del self._all[number]
        self._wake((*transition.inputs, *transition.outputs[:1]))

    def _link(self, number: int, transition: Transition) -> None:
        self._budget.pay(_COST + _COST_OF_OUTPUT * len(transition.outputs))
        for place in transition.inputs:
            self._from[place].add(number)
        for place in transition.outputs:
            self._into[place].add(number)

    def _unlink(self, number: int) -> None:
        for place in self._all[number].inputs:
            self._from[place].discard(number)
        for place in self._all[number].outputs:
            self._into[place].discard(number)

    def _remove(self, place: str) -> None:
        self._gone.add(place)
        self._into[place].clear()
        self._from[place].clear()

    def _wake(self, places: Iterable[str]) -> None:
        """Queues places for another check: their inputs or outputs have changed."""
        for place in places:
            if place not in self._queued and place not in self._gone:
                self._queued.add(place)
                self._queue.append(place)


def _reachable(net: Net) -> list[Transition]:
    """Transitions that a token can reach; the blocks of the others are dead."""
    waits: dict[str, list[int]] = {}
    missing: list[int] = []
    for number, transition in enumerate(net.transitions):
        missing.append(len(transition.inputs))
        for place in transition.inputs:
            waits.setdefault(place, []).append(number)
    seen, work = {net.start}, [net.start]
    while work:
        for number in waits.get(work.pop(), ()):
            missing[number] -= 1
            if missing[number] == 0:
                new = set(net.transitions[number].outputs) - seen
                seen |= new
                work += new
    return [transition for transition in net.transitions if transition.inputs & seen]
