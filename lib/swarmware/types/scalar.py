"""Single values, so that every resource has a type with a name."""

import msgspec

from swarmware.model.record_filter import Records, vlp16_records
from swarmware.types.registry import register


@register
class Float(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A single floating-point number."""

    value: float


@register
class Int(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A single whole number."""

    value: int


@register
class Bool(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A single truth value."""

    value: bool


@register
class Text(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A single character string."""

    value: str


@register
class Blob(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Opaque bytes, such as a lidar packet."""

    value: bytes

    @property
    def records(self) -> Records:
        """Packets of a lidar that can be recognised, for compression."""
        return vlp16_records(self.value)
