"""Requests of operators for the rules of notifications: each change is recorded, also a refused one."""

import asyncio

from swarmd.tree.core.action import Action
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.records.change_log import ChangeLog
from swarmd.tree.records.denial_log import DenialLog
from swarmd.tree.settings.rule_store import RuleStore
from swarmware.errors import SwarmError
from swarmware.model import names
from swarmware.model.access import Verb
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.runtime.driver import CoreDriver
from swarmware.types.tree import Rule, TreeChange, TreeRule, TreeRules


class RuleApi:
    """Serves `sys/tree/rule`."""

    def __init__(
        self,
        module: Module,
        tree: SwarmTree,
        driver: CoreDriver[Action],
        rules: RuleStore,
        changes: ChangeLog,
        denials: DenialLog,
    ) -> None:
        self._module = module
        self._tree = tree
        self._driver = driver
        self._rules = rules
        self._changes = changes
        self._denials = denials
        self._setting_rule = asyncio.Lock()

    def serve(self) -> None:
        """Registers the handler of the request."""
        self._module.serve("sys/tree/rule", TreeRule, self._rule, reply=TreeRules)

    async def _rule(self, request: TreeRule, meta: Meta) -> TreeRules:
        """Rules in force, after the change of one. Raises: Denied, NotFound, InvalidInput, SwarmError."""
        platform = self._module.platform
        if request.changes:
            shown, by = names.join(platform, request.pattern), self._module.requester(meta)
            before = _rule_text(self._rules.rules, request.pattern)
            via = () if meta.sender is None else meta.sender.via
            try:
                self._denials.check(meta, Verb.SET, request.pattern)
                # one change at a time: each begins with the rules that the former one has stored
                async with self._setting_rule:
                    await self._set_rule(request, shown)
            except SwarmError as error:
                # refusals as well: who tried what is the purpose of the record
                await self._changes.record(TreeChange(shown, by, before, "", str(error), via))
                raise
            after = _rule_text(self._rules.rules, request.pattern)
            await self._changes.record(TreeChange(shown, by, before, after, via=via))
        return TreeRules(platform, self._rules.rules)

    async def _set_rule(self, request: TreeRule, shown: str) -> None:
        rules = self._rules.changed(request)
        try:
            await asyncio.to_thread(self._rules.put, rules)
        except OSError as error:
            raise SwarmError(f"rule {shown}: cannot be stored: {error}; the old rules stay") from error
        # after the disk: a rule in force that a restart forgets would surprise the operator
        self._driver.feed(self._tree.on_rules(rules, self._module.now_ns()))


def _rule_text(rules: tuple[Rule, ...], pattern: str) -> str:
    """The rule of a pattern for the record of changes, or "" without one."""
    found = next((rule for rule in rules if rule.pattern == pattern), None)
    if found is None:
        return ""
    return (
        f"rule: deadband {found.deadband:g}, min interval {found.min_interval_s:g} s,"
        f" max interval {found.max_interval_s:g} s"
    )
