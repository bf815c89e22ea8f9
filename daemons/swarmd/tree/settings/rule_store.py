"""Storage of the operators' rules for notifications, in one file."""

import logging
from pathlib import Path
from typing import Final

import msgspec
import tomli_w

from swarmd.tree.config import RuleConfig
from swarmd.tree.core.notification.condition import check_rule
from swarmware.errors import ConfigError, InvalidInput, NotFound
from swarmware.model import document
from swarmware.model.clock import utc_ns
from swarmware.runtime.filewriter import replace_file, set_aside
from swarmware.types.tree import Rule, TreeRule
from swarmware.types.tree_exchange import RULES_LIMIT

FILE: Final = "rules.toml"
"""Name of the file in the data folder of the node."""

log = logging.getLogger("swarm.tree")


class _Stored(msgspec.Struct, forbid_unknown_fields=True):
    rules: tuple[RuleConfig, ...] = ()


class RuleStore:
    """The file `rules.toml`, which is replaced atomically; the newest rule is the first."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.rules: tuple[Rule, ...] = ()
        try:
            self.rules = self._read()
        except FileNotFoundError:
            return
        except (OSError, ConfigError) as error:
            # kept aside, not overwritten: the next change would destroy what an operator can repair
            aside = set_aside(path, f".broken-{utc_ns()}")
            log.error("%s: cannot be used (%s); kept as %s, no rule is in force", path, error, aside)

    def _read(self) -> tuple[Rule, ...]:
        raw = document.toml(document.read(self._path), str(self._path))
        try:
            stored = msgspec.convert(raw, _Stored).rules
        except (msgspec.ValidationError, InvalidInput) as error:
            raise ConfigError(f"{self._path}: not stored rules: {error}") from error
        return tuple(one.rule() for one in stored[:RULES_LIMIT])

    def changed(self, request: TreeRule) -> tuple[Rule, ...]:
        """The rules after a request. Raises: NotFound for a pattern without a rule, InvalidInput."""
        if not request.reset:
            return self._with(request)
        kept = tuple(rule for rule in self.rules if rule.pattern != request.pattern)
        if len(kept) == len(self.rules):
            known = ", ".join(rule.pattern for rule in self.rules) or "none"
            raise NotFound(f"rule {request.pattern}: not set; rules in force: {known}")
        return kept

    def _with(self, request: TreeRule) -> tuple[Rule, ...]:
        before = next((rule for rule in self.rules if rule.pattern == request.pattern), None)
        # fields that the request leaves out keep their value
        base = before or Rule(request.pattern)
        given = {
            name: value
            for name in ("deadband", "min_interval_s", "max_interval_s")
            if (value := getattr(request, name)) is not None
        }
        rule = msgspec.structs.replace(base, **given)
        check_rule(rule)
        if 0 < rule.max_interval_s < rule.min_interval_s:
            raise InvalidInput(
                f"rule {rule.pattern}: max_interval_s {rule.max_interval_s:g}; expected 0, or"
                f" {rule.min_interval_s:g} (min_interval_s) or more"
            )
        if before is not None:
            # in its place: the order decides which rule applies
            return tuple(rule if one is before else one for one in self.rules)
        if len(self.rules) >= RULES_LIMIT:
            raise InvalidInput(f"rule {rule.pattern}: {len(self.rules)} rules are set; expected fewer")
        return (rule, *self.rules)

    def put(self, rules: tuple[Rule, ...]) -> None:
        """Store the rules on the disk. Raises: OSError; nothing has changed then."""
        stored = [msgspec.to_builtins(_config(rule)) for rule in rules]
        self._path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(self._path, tomli_w.dumps({"rules": stored}).encode())
        self.rules = rules


def _config(rule: Rule) -> RuleConfig:
    return RuleConfig(
        pattern=rule.pattern,
        deadband=rule.deadband,
        min_interval_s=rule.min_interval_s,
        max_interval_s=rule.max_interval_s,
    )
