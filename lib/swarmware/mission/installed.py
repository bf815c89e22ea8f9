"""The block types that are installed on this computer, and their classes."""

from inspect import iscoroutinefunction
from typing import Any, Final, NamedTuple

import msgspec

from swarmware.footprint.entry_points import BLOCK_GROUP, EntryPoint, entry_points
from swarmware.mission.block_reader import KEYS
from swarmware.mission.catalogue import BLOCKS, BlockType, Catalogue, Params
from swarmware.model.platform_kind import PlatformKind

_CLASS: Final = "a class with `spec: BlockType` and `async def run(self, context)`"


class InstalledBlocks(msgspec.Struct, frozen=True):
    """The blocks of installed packages."""

    classes: dict[str, type]
    """Classes by the name of their type."""
    types: tuple[BlockType, ...]
    unusable: tuple[str, ...]
    """Unusable entry points, each with the reason and the expected value."""

    @property
    def catalogue(self) -> Catalogue:
        """The built-in types and these."""
        return Catalogue((*BLOCKS, *self.types), self.unusable)


def installed() -> Catalogue:
    """The catalogue of the built-in blocks and installed packages' blocks."""
    return installed_blocks().catalogue


def installed_blocks() -> InstalledBlocks:
    """The blocks of installed packages; an invalid block is left out, and stops no other."""
    # a package must not replace a built-in block, which missions of others rely on
    owners = dict.fromkeys((block.name for block in BLOCKS), "built-in")
    classes: dict[str, type] = {}
    types: list[BlockType] = []
    unusable: list[str] = []
    for point in entry_points(BLOCK_GROUP):
        found = _loaded(point)
        if not isinstance(found, str) and found.spec.name in owners:
            owner = owners[found.spec.name]
            found = f"block type {found.spec.name!r}: defined twice, it is {owner}; expected another name"
        if isinstance(found, str):
            unusable.append(f"{BLOCK_GROUP}:{point.name} ({point.value}): {found}")
            continue
        owners[found.spec.name] = f"a block of {point.value}"
        classes[found.spec.name] = found.cls
        types.append(found.spec)
    return InstalledBlocks(classes, tuple(types), tuple(unusable))


class _Block(NamedTuple):
    cls: type
    spec: BlockType


def _loaded(point: EntryPoint) -> _Block | str:
    """The block that an entry point names, or why it cannot be used."""
    try:
        cls = point.load()
    except Exception as error:  # noqa: BLE001 - the code of a package may raise anything; it becomes a finding
        return f"cannot be imported: {type(error).__name__}: {error}"
    spec = getattr(cls, "spec", None)
    if not isinstance(cls, type) or not isinstance(spec, BlockType):
        return f"expected {_CLASS}"
    # found now: at run time it would fail in the air
    if not iscoroutinefunction(getattr(cls, "run", None)):
        return f"run: expected {_CLASS}"
    return _invalid(spec) or _Block(cls, spec)


def _invalid(spec: Any) -> str:
    """Error in the type of a package's block, or "" if it is valid."""
    if not isinstance(spec.name, str) or not spec.name.isidentifier():
        return f"spec.name {spec.name!r}: expected one word, such as TakePhoto"
    if not isinstance(spec.params, type) or not issubclass(spec.params, Params):
        return f"spec.params {spec.params!r}: expected a subclass of swarmware.mission.catalogue.Params"
    fields = [field.encode_name for field in msgspec.structs.fields(spec.params)]
    if taken := sorted({*fields, *(other for other, _ in _pairs(spec.aliases))} & KEYS):
        return f"parameter {taken[0]!r}: a key of every block; expected another name"
    for other, name in _pairs(spec.aliases):
        if name not in fields:
            return (
                f"spec.aliases: {other!r} is for {name!r}, not a parameter; expected one of {_list(fields)}"
            )
    if len(_pairs(spec.aliases)) != len(spec.aliases):
        return f"spec.aliases {spec.aliases!r}: expected pairs of texts"
    for key, words in (("kinds", spec.kinds), ("errors", spec.errors)):
        if not isinstance(words, tuple) or not all(isinstance(word, str) and word for word in words):
            return f'spec.{key} {words!r}: expected a tuple of texts, such as ("a", "b")'
    if unknown := [kind for kind in spec.kinds if kind not in set(PlatformKind)]:
        return f"spec.kinds: unknown kind {str(unknown[0])!r}; expected some of {_list(PlatformKind)}"
    # the player executes those itself; a block of a package always takes a task
    if spec.control or spec.instant:
        return "spec.control and spec.instant: only built-in blocks have them; expected False"
    timeout_s = spec.timeout_s
    if timeout_s is not None and not (isinstance(timeout_s, int | float) and timeout_s > 0):
        return f"spec.timeout_s {timeout_s!r}: expected seconds above 0, or None"
    return ""


def _pairs(aliases: Any) -> list[tuple[str, str]]:
    return [pair for pair in aliases if isinstance(pair, tuple) and len(pair) == 2]


def _list(words: Any) -> str:
    return ", ".join(words) or "none"
