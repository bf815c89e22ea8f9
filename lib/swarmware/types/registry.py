"""Registry of payload types, and the codec of their values."""

import struct
from collections.abc import Callable
from functools import cache, lru_cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Protocol, TypeVar, runtime_checkable

import msgspec

import swarmware.types
from swarmware.errors import InvalidInput, NotFound, OutOfRange, WireError
from swarmware.model import compression
from swarmware.model.frame import PAYLOAD_LIMIT, Codec
from swarmware.model.record_filter import NO_RECORDS, Records

T = TypeVar("T", bound=msgspec.Struct)

_TYPES: dict[str, type[msgspec.Struct]] = {}

_encoder = msgspec.msgpack.Encoder()


@runtime_checkable
class Packs(Protocol):
    """A type with a quantised wire form of its own, shorter than MessagePack.

    Its classmethod `unpack(data)` is the inverse and raises WireError for anything else; its class variable
    `forms` documents the layouts.
    """

    def pack(self) -> bytes:
        """The value in its quantised form."""
        ...


@runtime_checkable
class HasRecords(Protocol):
    """A type whose last field is the bytes of equal records, which compress better as columns."""

    @property
    def records(self) -> Records:
        """Layout and size of the records, with which its MessagePack ends."""
        ...


def register(cls: type[T]) -> type[T]:
    """Class decorator: makes a payload type known by its class name.

    Raises: InvalidInput when another class has the name already.
    """
    # the same class may be registered twice, by a module that is reloaded
    known = _TYPES.setdefault(cls.__name__, cls)
    if known is not cls and known.__module__ != cls.__module__:
        raise InvalidInput(f"type {cls.__name__} of {cls.__module__}: the name belongs to {known.__module__}")
    _TYPES[cls.__name__] = cls
    return cls


def type_name(cls: type[msgspec.Struct]) -> str:
    """Name of a payload type in descriptors and data ids."""
    return cls.__name__


def known(cls: type[msgspec.Struct]) -> bool:
    """Whether a class is a registered payload type."""
    return _TYPES.get(cls.__name__) is cls


def installed(name: str) -> bool:
    """Whether a loaded or common module defines a type of that name."""
    try:
        find(name)
    except NotFound:
        return False
    return True


def find(name: str) -> type[msgspec.Struct]:
    """The payload type of that name.

    Raises: NotFound when no loaded module defines it.
    """
    # all areas are imported only for an unknown name: most processes need a few of them
    if name not in _TYPES:
        _import_all()
    try:
        return _TYPES[name]
    except KeyError:
        raise NotFound(f"type {name!r}: unknown here; expected one of {_names(len(_TYPES))}") from None


@lru_cache(maxsize=1)
def _names(_count: int) -> str:
    """Names of the registered types, for messages: sorted again only when their number has changed."""
    return ", ".join(sorted(_TYPES))


def quantities() -> frozenset[str]:
    """Names of all payload types, and of their fields, that loaded and common modules define."""
    _import_all()
    fields = (name for cls in list(_TYPES.values()) for name in cls.__struct_fields__)
    return frozenset(_TYPES).union(fields)


@cache
def _import_all() -> None:
    """Import the modules of this package, which register their types: once, a log may have a million values
    of a type that is unknown here."""
    for area in iter_modules(swarmware.types.__path__):
        import_module(f"swarmware.types.{area.name}")


def encode(value: msgspec.Struct) -> bytes:
    """The value as MessagePack.

    Raises: OutOfRange when it holds an integer of more than 64 bits.
    """
    try:
        return _encoder.encode(value)
    except OverflowError as error:
        raise OutOfRange(f"a value of type {type(value).__name__}: {error}; expected 64 bits") from error


@lru_cache(maxsize=512)
def _decoder(cls: type[T]) -> Callable[[bytes | memoryview], T]:
    return msgspec.msgpack.Decoder(cls).decode


def pack(value: msgspec.Struct) -> tuple[bytes, Codec]:
    """The value's shortest wire form and the codec that says which it is.

    Raises: OutOfRange as `encode`.
    """
    if isinstance(value, Packs):
        try:
            return value.pack(), Codec.PACKED
        except (ValueError, ArithmeticError, struct.error):
            pass  # a number that the quantised form cannot represent, such as NaN: MessagePack does
    return encode(value), Codec.NONE


def decode(cls: type[T], data: bytes | memoryview, codec: Codec = Codec.NONE) -> T:
    """The value in a payload.

    Raises: WireError with the path of the field that does not fit the type.
    """
    if codec is Codec.PACKED:
        unpack: Callable[[bytes | memoryview], T] | None = getattr(cls, "unpack", None)
        if unpack is None:
            raise WireError(f"payload of type {cls.__name__}: packed, but the type has no packed form")
        return unpack(data)
    if codec is not Codec.NONE:
        data = decompress(data, codec)
    try:
        value: T = _decoder(cls)(data)
        return value
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise WireError(f"payload of type {cls.__name__}: {error}") from error


def messagepack(type_name: str, data: bytes | memoryview, codec: Codec) -> bytes:
    """A payload of any codec as MessagePack.

    Only a packed payload needs its type. Raises: NotFound when it is unknown, WireError when the payload is
    damaged.
    """
    if codec is Codec.PACKED:
        return encode(decode(find(type_name), data, codec))
    return decompress(data, codec)


def decompress(data: bytes | memoryview, codec: Codec) -> bytes:
    """The payload without its compression, never longer than a frame may be.

    Raises: WireError when it is damaged or grows beyond the limit.
    """
    if codec is Codec.ZLIB:
        return compression.inflate(data, PAYLOAD_LIMIT)
    if codec is Codec.ZSTD:
        return compression.unzstd(data, PAYLOAD_LIMIT)
    return bytes(data)


def records(type_name: str, data: bytes) -> Records:
    """Records at the end of a payload in MessagePack; of types without any, of others' types and of damaged
    payloads: none."""
    try:
        cls = find(type_name)
        value = decode(cls, data) if hasattr(cls, "records") else None
    except (NotFound, WireError):
        return NO_RECORDS
    return value.records if isinstance(value, HasRecords) else NO_RECORDS
