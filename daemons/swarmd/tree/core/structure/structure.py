"""Wire format of structures: changes relative to a structure that the other side has."""

import zlib
from collections import OrderedDict
from collections.abc import Iterable
from enum import IntEnum
from typing import Annotated, Final

import msgspec

from swarmd.tree.core.structure.index import Index, Leaf, leaf
from swarmware.errors import WireError
from swarmware.model.names import PATH_LIMIT
from swarmware.model.resource import Resource

HISTORY: Final = 64
"""Former states of the own structure for which changes are kept."""
_ODD: Final = 0x9E37_79B1
"""Spreads the epoch over 32 bits. Source: Knuth, The Art of Computer Programming 3, section 6.4."""


class StructureEncoding(IntEnum):
    """Encoding of the structure in a reply."""

    UNCHANGED = 0
    CHANGES = 1
    """Changes to the structure of the requester."""
    TEMPLATE = 2
    """Changes to a template that both sides have."""
    FULL = 3
    """A template and the changes to it."""


DICTIONARY: Final = (
    b"\xa4kind\xa7command\xa6access\xa2rw\xa4unit\xa5reply\xa5range\xa7choices\xa7confirm\xa8critical\xc3\xa4mode"
    b"\xa3log\xa31hz\xa3all\xa7rate_hz\xcb@$\x00\x00\x00\x00\x00\x00\xa4link\xa4tick\xabdescription"
    b"\xa4kind\xa6stream\xa4kind\xa5event\xa4kind\xa7setting\xa8category\xa8periodic"
    b"/sys/nav/plan/cmd/config/health/vehicle/sensor/log/mission/state/status"
    b"\x94\x90\x90\x90\x90\x94\x91\x84\x94\x91\x85\xde\x00\x05\xa4path\xa7app/\xa4type\xa4Text"
    b"\xa8category\xabconditional\xa4link\xa6notify\xa5owner\xa7planner\x90\x90\x90"
)
"""Preset dictionary of the compression (RFC 1950, FDICT): frequent words of descriptors. One
resource beside a template takes 27 bytes with it, 88 without."""
PATHS_LIMIT: Final = 10_000
"""Resources of one platform, and paths in one change: a hundred times the largest template."""
PLAIN_LIMIT: Final = 4 * PATHS_LIMIT * 128
"""Bytes of changes without their compression: three lists of descriptors and one of paths."""

_Resources = Annotated[tuple[Resource, ...], msgspec.Meta(max_length=PATHS_LIMIT)]
_Paths = Annotated[
    tuple[Annotated[str, msgspec.Meta(max_length=PATH_LIMIT)], ...], msgspec.Meta(max_length=PATHS_LIMIT)
]


class Changes(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Changes from one structure to another."""

    put: _Resources = ()
    lost: _Resources = ()
    """Resources to put as well, whose owners are lost."""
    removed: _Paths = ()
    template: _Resources = ()
    """Base of the changes, instead of a structure of the other side."""


class Patch(msgspec.Struct, frozen=True, gc=False):
    """Changes as leaves, ready to be applied."""

    put: tuple[Leaf, ...]
    removed: tuple[str, ...]
    template: tuple[Leaf, ...]

    @property
    def paths(self) -> int:
        """Number of paths; at least 1, because an empty patch takes memory, too."""
        return 1 + len(self.put) + len(self.removed) + len(self.template)

    def apply(self, index: Index) -> None:
        """Apply the changes to an index.

        Raises: WireError when the structure would grow beyond the limit.
        """
        for path in self.removed:
            index.remove(path)
        for item in self.put:
            index.put(item)
        if len(index) > PATHS_LIMIT:
            raise WireError(f"structure of {len(index)} resources: expected at most {PATHS_LIMIT}")


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(Changes)


def version(epoch: int, digest: int) -> int:
    """Version of the tree for the hello: it differs after a restart of the tree and after any change."""
    return ((digest ^ digest >> 32) ^ epoch * _ODD) & 0xFFFF_FFFF


def encode(put: Iterable[Leaf], removed: Iterable[str], template: Iterable[Leaf] = ()) -> bytes:
    """Changes for the wire."""
    put = sorted(put, key=lambda item: item.resource.path)
    changes = Changes(
        tuple(item.resource for item in put if not item.lost),
        tuple(item.resource for item in put if item.lost),
        tuple(sorted(removed)),
        tuple(item.resource for item in template),
    )
    deflate = zlib.compressobj(6, zdict=DICTIONARY)
    return deflate.compress(_encoder.encode(changes)) + deflate.flush()


class Patches:
    """Decodes changes from the wire and caches them: platforms of one kind send the same ones.

    Bounded by the number of paths that are held, not by the number of changes.
    """

    def __init__(self, paths: int = 4 * PATHS_LIMIT) -> None:
        self._room = paths
        self._held: OrderedDict[bytes, Patch] = OrderedDict()
        self.paths = 0
        """Number of paths in the cache."""

    def decode(self, data: bytes) -> Patch:
        """The changes in these bytes. Raises: WireError."""
        known = self._held.get(data)
        if known is not None:
            self._held.move_to_end(data)
            return known
        patch = decode(data)
        # a patch larger than the cache would empty it for nothing
        if patch.paths <= self._room:
            self._held[data] = patch
            self.paths += patch.paths
            while self.paths > self._room:
                self.paths -= self._held.popitem(last=False)[1].paths
        return patch


def decode(data: bytes) -> Patch:
    """Changes from the wire. Raises: WireError."""
    inflate = zlib.decompressobj(zdict=DICTIONARY)
    try:
        # bounded: a few bytes of deflate may stand for gigabytes
        plain = inflate.decompress(data, PLAIN_LIMIT)
        if not inflate.eof:
            raise WireError(f"cut short, or more than {PLAIN_LIMIT} bytes")
        changes = _decoder.decode(plain)
    except (zlib.error, msgspec.DecodeError, RecursionError, ValueError) as error:
        raise WireError(f"structure: {error}") from error
    put = [leaf(resource) for resource in changes.put]
    put += [leaf(resource, lost=True) for resource in changes.lost]
    return Patch(tuple(put), changes.removed, tuple(leaf(resource) for resource in changes.template))


class History:
    """Changed paths since former states of the structure, by digest."""

    def __init__(self) -> None:
        self._steps: OrderedDict[int, frozenset[str]] = OrderedDict()

    def add(self, before: int, paths: frozenset[str]) -> None:
        """The structure with that digest was changed at these paths."""
        self._steps.pop(before, None)  # a former state occurs again: only later changes count
        self._steps[before] = paths
        while len(self._steps) > HISTORY:
            self._steps.popitem(last=False)

    def since(self, digest: int) -> set[str] | None:
        """Paths that changed since then, or None if that is unknown."""
        if digest not in self._steps:
            return None
        paths: set[str] = set()
        found = False
        for before, changed in self._steps.items():
            found = found or before == digest
            if found:
                paths |= changed
        return paths
