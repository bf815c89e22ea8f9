"""The trees of other platforms as known here: the four steps of S0.54–57, and what we want of each."""

import logging
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import msgspec

from swarmd.tree.core import structure
from swarmd.tree.core.action import Action, AskStructure, AskSubscription, Forget, KeepOnly
from swarmd.tree.core.arrivals import Arrivals
from swarmd.tree.core.index import Index, Leaf, leaf, pattern
from swarmd.tree.core.interest import NOTHING, Interests, subscribable
from swarmd.tree.core.local import LocalTree
from swarmd.tree.core.remote import Remote
from swarmd.tree.core.structure import Form, Patches
from swarmd.tree.core.timers import Timers
from swarmware.errors import OutOfRange, WireError
from swarmware.names import check_platform
from swarmware.resource import Resource
from swarmware.types.net import BoardSubscription
from swarmware.types.tree import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeItem,
    TreeNotify,
)

log = logging.getLogger("swarm.tree")

ANOTHER: Final = -1
"""Digest of a subscription that is not known here."""
RETIRED: Final = 8
"""Former starts of another tree whose late notifications are known as such."""
TEMPLATES_LIMIT: Final = 64
"""Templates learnt from others and kept."""
PLATFORMS_LIMIT: Final = 2000
"""Bounds the memory that invented names can take; twenty times the swarm of `tests/simulation/tree`."""


class ReplicaTimeouts(msgspec.Struct, frozen=True, kw_only=True):
    """When to ask again, and for how long to remember."""

    lease_ns: int
    retry_ns: tuple[int, ...]
    """Pauses after failures in a row."""
    forget_ns: int
    whole_swarm: bool = False
    """Keep up with every platform; else with neighbours, and with those that somebody here reads."""


class Remotes:
    """Asks, remembers and subscribes."""

    def __init__(
        self,
        tree: LocalTree,
        own: str,
        interests: Interests,
        templates: Iterable[Iterable[Resource]],
        timeouts: ReplicaTimeouts,
        emit: Callable[[Action], None],
    ) -> None:
        self._tree = tree
        self._own = own
        self._interests = interests
        self._timeouts = timeouts
        self._emit = emit
        self._remotes: dict[str, Remote] = {}
        self._templates: dict[int, Index] = {}
        for template in templates:
            index = Index(leaf(resource) for resource in template)
            self._templates[index.digest] = index
        self._patches = Patches()
        self._timers: Timers[tuple[str, str]] = Timers()
        self.plan_count = 0
        """Rises with each change of `wants`."""

    def __iter__(self) -> Iterator[Remote]:
        return iter(self._remotes.values())

    def get(self, platform: str) -> Remote | None:
        """What is known of a platform."""
        return self._remotes.get(platform)

    def platforms(self) -> list[str]:
        """Every other platform that is known."""
        return list(self._remotes)

    def wants(self) -> list[BoardSubscription]:
        """Boards wanted from beacons."""
        return [
            BoardSubscription(platform, resource.path, resource.type, resource.data_id)
            for platform in sorted(self._remotes)
            for resource in self._remotes[platform].wants
        ]

    # -- the network

    def on_up(self, platform: str, version: int | None, near: bool, now_ns: int) -> None:
        """Step 1 of S0.54: it can be reached, `near`: directly. `version`: of its tree, if it is known."""
        remote = self._remotes.get(platform)
        if remote is None:
            if len(self._remotes) >= PLATFORMS_LIMIT and not self._make_room():
                return
            remote = self._remotes[platform] = Remote(platform, self._interests.of(platform))
        if version is not None or not (remote.up and remote.sure):
            if version != remote.hint:
                remote.checked = None  # a structure may come back to what it was
            remote.hint = version  # what was heard of it before it went may have changed since
        remote.near = near
        if not remote.up:
            remote.up = True
            # for half a lease it holds our subscription: a hello with the version we know says all else
            away = now_ns - remote.gone_ns >= self._timeouts.lease_ns // 2
            remote.sure = version is not None and not away and self._same(remote)
            remote.failures = 0
            self._timers.drop((platform, "forget"))
        self._engage(remote)

    def on_left_behind(self, platform: str, now_ns: int) -> None:
        """There are mirrors of it from a former start: it is forgotten like any that went away."""
        if platform not in self._remotes and len(self._remotes) < PLATFORMS_LIMIT:
            remote = self._remotes[platform] = Remote(platform, self._interests.of(platform))
            remote.gone_ns = now_ns
            self._timers.set((platform, "forget"), now_ns + self._timeouts.forget_ns)

    def demand(self, platform: str) -> None:
        """Somebody wants to see its structure."""
        remote = self._remotes.get(platform)
        if remote is None or not remote.up:
            return
        if remote.index is None or not self._keeps_up(remote):
            remote.demanded = True
            self._ask(remote)

    def asks(self, platform: str) -> bool:
        """Whether an answer of it may come."""
        remote = self._remotes.get(platform)
        return remote is not None and remote.up and remote.asking

    def on_gone(self, platform: str, now_ns: int) -> None:
        """It cannot be reached any more."""
        remote = self._remotes.get(platform)
        if remote is not None and remote.up:
            remote.up = False
            remote.gone_ns = now_ns
            for what in ("ask", "subscribe"):
                self._timers.drop((platform, what))
            self._timers.set((platform, "forget"), now_ns + self._timeouts.forget_ns)

    def on_asked_by(self, platform: str, epoch: int, digest: int | None) -> None:
        """It asked us something and told its epoch, and perhaps its digest: a hint for our direction."""
        remote = self._remotes.get(platform)
        if remote is None:
            return
        remote.told = (epoch, digest)
        self._check(remote)

    def on_structure(self, platform: str, reply: StructureReply | None, now_ns: int) -> None:
        """Step 4 of S0.57: its answer, or None when there was none."""
        remote = self._remotes.get(platform)
        if remote is None or not remote.asking:
            return
        remote.asking = False
        if reply is None:
            self._retry(remote, "ask", now_ns)
            return
        full = remote.full
        remote.full = False
        try:
            index = self._built(remote, reply)
        except WireError as error:
            log.warning("structure of %s: %s", platform, error)
            index = None
        if index is None:
            if full:  # everything was sent and it does not fit: not worth hurrying
                self._retry(remote, "ask", now_ns)
                return
            remote.full = True
            self._ask(remote)
            return
        remote.checked = remote.asked_hint
        remote.failures = 0
        self._learn(remote, reply.epoch, index)
        remote.demanded = False
        if remote.confirmed is not None and remote.confirmed[0] != remote.epoch:
            remote.confirmed = None  # it started again
        if remote.owes or (remote.wish.patterns and not remote.sure):
            self._subscribe(remote)
        else:
            remote.sure = True
        self._check(remote)

    def on_subscribed(self, platform: str, reply: SubscribeReply | None, asked: int, now_ns: int) -> None:
        """The answer to our subscription, or None when there was none; `asked`: digest of the wish sent."""
        remote = self._remotes.get(platform)
        if remote is None or not remote.subscribing:
            return
        remote.subscribing = False
        if reply is None:
            self._retry(remote, "subscribe", now_ns)
            return
        remote.failures = 0
        remote.sure = True
        if reply.unknown:
            again = remote.confirmed is None
            remote.confirmed = None
            if again:  # sent whole, and still not held: its table is full
                self._retry(remote, "subscribe", now_ns)
            else:
                self._subscribe(remote)
        else:
            remote.confirmed = None if asked == NOTHING.digest else (reply.epoch, asked)
            if remote.owes:
                self._subscribe(remote)
        remote.told = (reply.epoch, reply.digest)
        self._check(remote)

    def on_notify(self, notify: TreeNotify, now_ns: int) -> list[TreeItem]:
        """A notification; the values in it that are for a mirror. Raises: InvalidInput, WireError."""
        remote = self._remotes.get(notify.platform)
        if remote is None:
            check_platform(notify.platform)
            if len(self._remotes) >= PLATFORMS_LIMIT:
                raise OutOfRange(f"{notify.platform}: no room; {PLATFORMS_LIMIT} platforms are known")
            # its route to us is older than ours to it
            remote = self._remotes[notify.platform] = Remote(
                notify.platform, self._interests.of(notify.platform)
            )
            self._timers.set((notify.platform, "forget"), now_ns + self._timeouts.forget_ns)
        if notify.epoch in remote.retired:
            return []
        if notify.lapsed:
            remote.confirmed = None
            if remote.owes:
                self._subscribe(remote)
            return []
        if notify.epoch != remote.notify_epoch:
            remote.notify_epoch, remote.arrivals = notify.epoch, {}
        if notify.epoch != remote.epoch:
            # it started again, and was faster than the answer that tells us so
            remote.told = (notify.epoch, None)
            self._check(remote)
        arrivals = remote.arrivals.setdefault(notify.lane, Arrivals())
        return [item for ready in arrivals.take(notify) for item in self._taken(remote, ready)]

    def _taken(self, remote: Remote, notify: TreeNotify) -> list[TreeItem]:
        if notify.base:
            self._on_changes(remote, notify)
        patterns = remote.wish.patterns
        if notify.items and not patterns and remote.confirmed is None:
            # a former start of ours wanted them, it still holds that subscription
            remote.confirmed = (notify.epoch, ANOTHER)
            self._subscribe(remote)
        return [item for item in notify.items if any(pattern(text).matches(item.path) for text in patterns)]

    # -- this platform

    def on_interests(self) -> None:
        """Applications here want something else."""
        for remote in self._remotes.values():
            wish = self._interests.of(remote.platform)
            if wish.digest != remote.wish.digest:
                remote.wish = wish
                self._match(remote)
                self._engage(remote)
                if remote.index is not None:
                    self._subscribe(remote)

    def on_timer(self, now_ns: int) -> None:
        """Retries, and platforms that have been away too long."""
        while (key := self._timers.pop(now_ns)) is not None:
            platform, what = key
            remote = self._remotes.get(platform)
            if remote is None:
                continue
            if what == "forget":
                # where last values are kept, a platform that was lost is what they are kept for
                if not self._interests.keep or remote.index is None:
                    self._forget(remote)
            elif what == "ask":
                self._ask(remote)
            else:
                self._subscribe(remote)

    def deadline_ns(self) -> int | None:
        """When `on_timer` has something to do."""
        return self._timers.next_ns()

    # -- inside

    def _forget(self, remote: Remote) -> None:
        del self._remotes[remote.platform]
        self.plan_count += bool(remote.wants)
        self._emit(Forget(remote.platform))

    def _make_room(self) -> bool:
        """Forget the platform that has been away longest; False when none is away."""
        away = [remote for remote in self._remotes.values() if not remote.up]
        if away:
            self._forget(min(away, key=lambda remote: remote.gone_ns))
        return bool(away)

    def _keeps_up(self, remote: Remote) -> bool:
        """Whether its tree is to be followed, and not only looked at when somebody asks for it."""
        return remote.near or bool(remote.wish.patterns) or self._timeouts.whole_swarm

    def _engage(self, remote: Remote) -> None:
        """Do what is missing, now that it is up, near or wanted."""
        if not remote.up:
            return
        if not self._keeps_up(remote):
            remote.sure = False  # what it says until it matters again is missed
            return
        if remote.index is None or not self._fits(remote):
            self._check(remote)
        elif not remote.sure or remote.owes:
            # a second visit: the renewal tells both digests
            self._subscribe(remote)
        else:
            self._check(remote)

    def _same(self, remote: Remote) -> bool:
        """Whether its structure is the one we have, and its subscription what we want."""
        return not remote.owes and remote.index is not None and self._exactly(remote)

    def _exactly(self, remote: Remote) -> bool:
        return remote.epoch is not None and remote.hint == structure.version(remote.epoch, remote.digest)

    def _fits(self, remote: Remote) -> bool:
        """Whether what we know is what was last heard of."""
        if remote.hint is None or remote.hint == remote.checked:
            return remote.index is not None
        return self._exactly(remote)

    def _check(self, remote: Remote) -> None:
        """Ask if anything heard since it was last asked speaks of another structure, or of another start."""
        if remote.asking or not remote.up or not self._keeps_up(remote):
            return
        told, remote.told = remote.told, None
        news = told is not None and (
            told[0] != remote.epoch or (told[1] is not None and told[1] != remote.digest)
        )
        if news or not self._fits(remote):
            self._ask(remote)

    def _ask(self, remote: Remote) -> None:
        if remote.up and not remote.asking and (remote.demanded or self._keeps_up(remote)):
            remote.asking = True
            remote.asked_hint, remote.told = remote.hint, None
            self._timers.drop((remote.platform, "ask"))
            request = StructureRequest(
                self._own, self._tree.epoch, self._tree.digest, remote.digest, remote.full
            )
            self._emit(AskStructure(remote.platform, request))

    def _subscribe(self, remote: Remote) -> None:
        """Ask for what is wanted, or whether it is still held; where nothing is, look at the structure."""
        if not remote.up or remote.subscribing:
            return
        if not remote.wish.patterns and remote.confirmed is None:
            if remote.index is not None and not self._exactly(remote):
                self._ask(remote)
            return
        wish = remote.wish
        remote.subscribing = True
        self._timers.drop((remote.platform, "subscribe"))
        renew = remote.holds
        request = SubscribeRequest(
            self._own,
            self._tree.epoch,
            wish.digest,
            self._timeouts.lease_ns / 1e9,
            remote.digest,
            renew,
            () if renew else wish.patterns,
            () if renew else wish.rules,
        )
        self._emit(AskSubscription(remote.platform, request))

    def _retry(self, remote: Remote, what: str, now_ns: int) -> None:
        if remote.up:
            pauses = self._timeouts.retry_ns
            self._timers.set((remote.platform, what), now_ns + pauses[min(remote.failures, len(pauses) - 1)])
            remote.failures += 1

    def _built(self, remote: Remote, reply: StructureReply) -> Index | None:
        """The structure that the reply tells; None when it cannot be put together here."""
        if reply.form == Form.UNCHANGED:
            index = remote.index
        else:
            patch = self._patches.decode(reply.data)
            index = self._base(remote, reply, patch.template)
            if index is not None:
                patch.apply(index)
        return index if index is not None and index.digest == reply.digest else None

    def _base(self, remote: Remote, reply: StructureReply, told: tuple[Leaf, ...]) -> Index | None:
        if reply.form == Form.CHANGES:
            return None if remote.index is None else remote.index.copy()
        known = self._templates.get(reply.base)
        if known is None and reply.form == Form.FULL:
            known = Index(told)  # no more than `structure` lets through
            if known.digest != reply.base:
                return None
            while len(self._templates) >= TEMPLATES_LIMIT:
                del self._templates[next(iter(self._templates))]
            self._templates[reply.base] = known
        return None if known is None else known.copy()

    def _learn(self, remote: Remote, epoch: int, index: Index) -> None:
        for former in (remote.epoch, remote.notify_epoch):
            if former is not None and former != epoch and former not in remote.retired:
                remote.retired = (*remote.retired, former)[-RETIRED:]
        if epoch in remote.retired:
            remote.retired = tuple(one for one in remote.retired if one != epoch)
        remote.epoch = epoch
        self._set_index(remote, index)

    def _set_index(self, remote: Remote, index: Index) -> None:
        former, remote.index = remote.index, index
        if former is None or any(item.resource.path not in index for item in former):
            self._emit(KeepOnly(remote.platform, frozenset(item.resource.path for item in index)))
        self._match(remote)

    def _on_changes(self, remote: Remote, notify: TreeNotify) -> None:
        index = remote.index
        if index is not None and index.digest == notify.digest:
            return
        if index is not None and index.digest == notify.base and notify.structure:
            try:
                index = index.copy()
                self._patches.decode(notify.structure).apply(index)
            except WireError as error:
                log.warning("structure of %s: %s", remote.platform, error)
            else:
                if index.digest == notify.digest:
                    self._set_index(remote, index)
                    return
        self._ask(remote)

    def _match(self, remote: Remote) -> None:
        """What we want of it in beacons."""
        key = (remote.digest, remote.wish.digest)
        if remote.wanted_of == key:
            return
        remote.wanted_of = key
        patterns = remote.wish.patterns
        wanted = {
            item.resource.path: item.resource
            for text in patterns
            for item in (remote.index.match(text) if remote.index is not None else ())
            if item.resource.link == "tick" and subscribable(item, patterns)
        }
        wants = tuple(wanted[path] for path in sorted(wanted))
        if wants != remote.wants:
            remote.wants = wants
            self.plan_count += 1
