"""The trees of other platforms as known here: the four steps of S0.54–57, and what we want of each."""

import logging
from collections.abc import Callable, Iterable, Iterator
from typing import Final
from zlib import crc32

import msgspec

from swarmd.tree.core import structure
from swarmd.tree.core.action import Action, AskStructure, AskSubscription, Forget
from swarmd.tree.core.index import Index, Leaf, leaf, pattern
from swarmd.tree.core.interest import Interests, subscribable
from swarmd.tree.core.local import LocalTree
from swarmd.tree.core.remote import Remote
from swarmd.tree.core.structure import Form, Patches
from swarmd.tree.core.timers import Timers
from swarmware.errors import OutOfRange, WireError
from swarmware.names import check_platform
from swarmware.resource import Resource
from swarmware.types.net import Want
from swarmware.types.tree import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeItem,
    TreeNotify,
)

log = logging.getLogger("swarm.tree")

RETIRED: Final = 8
"""Former starts of another tree whose late notifications are known as such."""
TEMPLATES_LIMIT: Final = 64
"""Templates learnt from others and kept."""
PLATFORMS_LIMIT: Final = 2000
"""Twice the largest swarm simulated (scale study, section 2)."""


class Patience(msgspec.Struct, frozen=True, kw_only=True):
    """When to ask again, and for how long to remember."""

    lease_ns: int
    retry_ns: tuple[int, ...]
    """Pauses after failures in a row."""
    forget_ns: int
    whole_swarm: bool = False
    """Keep up with every platform; else with neighbours, and with those that somebody here reads."""


class Remotes:
    """Asks, remembers, subscribes and renews."""

    def __init__(
        self,
        tree: LocalTree,
        own: str,
        interests: Interests,
        templates: Iterable[Iterable[Resource]],
        patience: Patience,
        emit: Callable[[Action], None],
    ) -> None:
        self._tree = tree
        self._own = own
        self._interests = interests
        self._patience = patience
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

    def wants(self) -> list[Want]:
        """Boards wanted from tick datagrams."""
        return [
            Want(platform, resource.path, resource.type, resource.data_id)
            for platform in sorted(self._remotes)
            for resource in self._remotes[platform].wants
        ]

    # -- the network

    def on_up(self, platform: str, version: int | None, near: bool) -> None:
        """Step 1 of S0.54: it can be reached, `near`: directly. `version`: of its tree, if it is known."""
        remote = self._remotes.get(platform)
        if remote is None:
            if len(self._remotes) >= PLATFORMS_LIMIT:
                return
            remote = self._remotes[platform] = Remote(platform, self._interests.of(platform))
        if version is not None:
            remote.hint = version
        remote.near = near
        if not remote.up:
            remote.up = True
            remote.sure = False
            remote.failures = 0
            self._timers.drop((platform, "forget"))
        self._engage(remote)

    def demand(self, platform: str) -> bool:
        """Somebody wants to see its structure; whether an answer may come."""
        remote = self._remotes.get(platform)
        if remote is None or not remote.up:
            return False
        if remote.index is None or not self._keeps_up(remote):
            remote.demanded = True
            self._ask(remote)
        return remote.asking

    def on_gone(self, platform: str, now_ns: int) -> None:
        """It cannot be reached any more."""
        remote = self._remotes.get(platform)
        if remote is not None and remote.up:
            remote.up = False
            for what in ("ask", "subscribe"):
                self._timers.drop((platform, what))
            self._timers.set((platform, "forget"), now_ns + self._patience.forget_ns)

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
        if not remote.sure or remote.confirmed != (remote.epoch, remote.wish.digest):
            self._subscribe(remote)
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
            remote.confirmed = (reply.epoch, asked)
            if asked != remote.wish.digest:
                self._subscribe(remote)
            else:
                self._timers.set((platform, "subscribe"), now_ns + self._renew_ns(platform))
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
            self._timers.set((notify.platform, "forget"), now_ns + self._patience.forget_ns)
        if notify.epoch in remote.retired:
            return []
        if notify.epoch != remote.notify_epoch:
            remote.notify_epoch, remote.serial = notify.epoch, 0
        if notify.serial <= remote.serial:
            return []
        remote.serial = notify.serial
        if notify.epoch != remote.epoch:
            # it started again, and was faster than the answer that tells us so
            remote.told = (notify.epoch, None)
            self._check(remote)
        if notify.base:
            self._on_changes(remote, notify)
        patterns = remote.wish.patterns
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
        """Retries, renewals, and platforms that have been away too long."""
        while (key := self._timers.pop(now_ns)) is not None:
            platform, what = key
            remote = self._remotes.get(platform)
            if remote is None:
                continue
            if what == "forget":
                del self._remotes[platform]
                self.plan_count += bool(remote.wants)
                self._emit(Forget(platform))
            elif what == "ask":
                self._ask(remote)
            else:
                self._subscribe(remote)

    def deadline_ns(self) -> int | None:
        """When `on_timer` has something to do."""
        return self._timers.next_ns()

    # -- inside

    def _keeps_up(self, remote: Remote) -> bool:
        """Whether its tree is to be followed, and not only looked at when somebody asks for it."""
        return remote.near or bool(remote.wish.patterns) or self._patience.whole_swarm

    def _engage(self, remote: Remote) -> None:
        """Do what is missing, now that it is up, near or wanted."""
        if not remote.up:
            return
        if not self._keeps_up(remote):
            remote.sure = False  # what it says until it matters again is missed
            return
        if remote.index is None or not self._fits(remote):
            self._check(remote)
        elif not remote.sure:
            # a second visit: the renewal tells both digests
            self._subscribe(remote)
        else:
            self._check(remote)

    def _fits(self, remote: Remote) -> bool:
        """Whether what we know is what was last heard of."""
        if remote.hint is None or remote.hint == remote.checked:
            return remote.index is not None
        return remote.epoch is not None and remote.hint == structure.version(remote.epoch, remote.digest)

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
        if not remote.up or remote.subscribing:
            return
        wish = remote.wish
        # the last wish is taken back, even where nothing else is wanted any more
        if not self._keeps_up(remote) and (remote.confirmed is None or remote.confirmed[1] == wish.digest):
            return
        remote.subscribing = True
        self._timers.drop((remote.platform, "subscribe"))
        renew = remote.confirmed is not None and remote.confirmed == (remote.epoch, wish.digest)
        request = SubscribeRequest(
            self._own,
            self._tree.epoch,
            wish.digest,
            self._patience.lease_ns / 1e9,
            remote.digest,
            renew,
            () if renew else wish.patterns,
            () if renew else wish.rules,
        )
        self._emit(AskSubscription(remote.platform, request))

    def _retry(self, remote: Remote, what: str, now_ns: int) -> None:
        if remote.up:
            pauses = self._patience.retry_ns
            self._timers.set((remote.platform, what), now_ns + pauses[min(remote.failures, len(pauses) - 1)])
            remote.failures += 1

    def _renew_ns(self, platform: str) -> int:
        # spread, or a swarm that was switched on together renews together for ever
        share = crc32(f"{self._own} {platform}".encode()) / 0xFFFF_FFFF
        return int(self._patience.lease_ns * (0.4 + 0.2 * share))

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
        remote.epoch, remote.index = epoch, index
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
                    remote.index = index
                    self._match(remote)
                    return
        self._ask(remote)

    def _match(self, remote: Remote) -> None:
        """What we want of it in tick datagrams."""
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
