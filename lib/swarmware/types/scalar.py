"""Single values, so that every resource has a type with a name."""

import msgspec

from swarmware.types.registry import register


@register
class Float(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A number."""

    value: float


@register
class Int(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A whole number."""

    value: int


@register
class Bool(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Yes or no."""

    value: bool


@register
class Text(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A string."""

    value: str


@register
class Blob(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Bytes that nobody between writer and reader looks into, such as a lidar packet."""

    value: bytes
