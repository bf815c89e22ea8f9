"""Requests of operators about channels: each is recorded with its requester, also a refused one."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import msgspec

from swarmd.broker.boards.channel_store import ChannelStore
from swarmd.broker.core.boards.channel_table import QUESTION, ChannelTable, refusals, without_video
from swarmware.errors import SwarmError
from swarmware.model import names, template
from swarmware.model.resource import Kind, Resource
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.channel import ChannelLimits, ClearChannels, SetChannel, UndoChannel
from swarmware.types.tree import TreeChange, TreeListing

PATH: Final = "net/limits"
"""The board that changes, in the record."""
NO_RULE: Final = "no rule"
"""In the record: none of the rules that changed."""
SAME_RULES: Final = "the same rules"
"""In the record: at most their order has changed."""
TREE_S: Final = 0.5
"""For the answer of this node's tree: a change is effective within a second."""

_RuleKey = tuple[str, int | None]
"""Text of a rule and the instant of its end, which distinguish it from what it was before a change."""

log = logging.getLogger("swarm.broker")


class ChannelApi:
    """Serves the changes of the rules of channels."""

    def __init__(self, module: Module, table: ChannelTable, limits: BoardWriter[ChannelLimits]) -> None:
        self._module = module
        self._table = table
        self._store = ChannelStore(table, module.node.config.data_path, module.clock)
        self._limits = limits
        self._changes = module.stream_writer(
            "net/changes", TreeChange, kind="event", description="Changes of channels by operators"
        )
        self._written: dict[_RuleKey, str] = {}
        """The rules of operators as they were published last."""
        self._write()

    def serve(self) -> None:
        """Registers the handlers of the requests."""
        serve = self._module.serve
        serve("sys/broker/set_channel", SetChannel, self._serve_set, reply=ChannelLimits)
        serve("sys/broker/undo_channel", UndoChannel, self._serve_undo, reply=ChannelLimits)
        serve("sys/broker/clear_channels", ClearChannels, self._serve_clear, reply=ChannelLimits)

    async def _serve_set(self, request: SetChannel, meta: Meta) -> ChannelLimits:
        listing = await self._video_listing() if request.settings.is_video else TreeListing(())
        with self._recorded(meta, str(request)):
            present = self._table.limits(self._module.now_ns()).limits
            refused = refusals(request, self._resources(), present)
            refused += without_video(request, self._module.platform, listing)
            self._table.set(request, self._module.now_ns())
            self._store.keep()
        return ChannelLimits(self._write().limits, refused)

    async def _video_listing(self) -> TreeListing:
        """Platforms with the service `video`, as the tree of this node knows them."""
        try:
            return await self._module.request("sys/tree/list", QUESTION, TreeListing, timeout_s=TREE_S)
        except SwarmError as error:
            log.info("receivers of video are not known: %s", error)
            return TreeListing(())

    def _serve_undo(self, _request: UndoChannel, meta: Meta) -> ChannelLimits:
        with self._recorded(meta, "undo"):
            self._table.undo(self._module.now_ns())
            self._store.keep()
        return self._write()

    def _serve_clear(self, request: ClearChannels, meta: Meta) -> ChannelLimits:
        with self._recorded(meta, f"clear {request.pattern}".rstrip()):
            self._table.clear(request.pattern)
            self._store.keep()
        return self._write()

    @contextmanager
    def _recorded(self, meta: Meta, change: str) -> Iterator[None]:
        """Records a change that is made in the meantime, or its refusal."""
        before = self._rules()
        shown = names.join(self._module.platform, PATH)
        by, via = self._module.requester(meta), () if meta.sender is None else meta.sender.via
        try:
            yield
        except SwarmError as error:
            self._changes.write(TreeChange(shown, by, "", change, str(error), via))
            raise
        self._changes.write(TreeChange(shown, by, *_difference(before, self._rules()), via=via))

    def on_time_over(self) -> None:
        """Publishes and records what is in force after the time of a rule is over."""
        before, module = self._written, self._module
        self._write()
        by, path = f"{module.name}@{module.platform}", names.join(module.platform, PATH)
        self._changes.write(TreeChange(path, by, *_difference(before, self._written)))

    def _write(self) -> ChannelLimits:
        limits = self._table.limits(self._module.now_ns())
        self._limits.write(limits)
        self._written = self._rules()
        return limits

    def _rules(self) -> "dict[_RuleKey, str]":
        """Texts of the rules of operators."""
        now_ns = self._module.now_ns()
        found: dict[_RuleKey, str] = {}
        for rule in self._table.limits(now_ns).limits:
            if not rule.from_file:
                left_s = rule.remaining_s
                ends_ns = None if left_s is None else now_ns + round(left_s * 1e9)
                found[str(rule), ends_ns] = f"{rule}" if left_s is None else f"{rule} --for {left_s:.3g}s"
        return found

    def _resources(self) -> list[Resource]:
        """Resources of local applications; how they travel is decided by the template, where it has them."""
        node = self._module.node
        node.table.refresh()
        resources = template.load(node.config.template, node.config.share_path / "templates").resources
        links = {each.path: each.link for each in resources if each.kind is Kind.BOARD}
        # settings are kept by the tree, no application provides them
        settings = [each for each in resources if each.kind is Kind.SETTING]
        return settings + [
            msgspec.structs.replace(each, link=links[each.path])
            if each.kind is Kind.BOARD and each.path in links
            else each
            for entry in node.table
            for each in entry.provides
        ]


def _difference(before: dict[_RuleKey, str], after: dict[_RuleKey, str]) -> tuple[str, str]:
    """The rules that only one of two times has, those before and those after."""
    if before.keys() == after.keys():
        return SAME_RULES, SAME_RULES
    gone = ", ".join(text for key, text in before.items() if key not in after)
    new = ", ".join(text for key, text in after.items() if key not in before)
    return gone or NO_RULE, new or NO_RULE
