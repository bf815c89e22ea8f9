"""Parameters of blocks that use resources and services of the platform, and the base of all parameters."""

from typing import Annotated, Any, Final, Literal

import msgspec

from swarmware.errors import InvalidInput
from swarmware.mission.condition_parser import parse as parse_condition
from swarmware.model.names import Pattern, split_field

VALUE: Final = "sensor"
"""Path under which a condition on a single value names that value."""

Text = Annotated[str, msgspec.Meta(max_length=500)]
Path = Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
ServiceName = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]


class Params(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of a block; a block type has a subclass with its own."""

    @property
    def lasts_s(self) -> float:
        """Time that the parameters require; the default time-out of the type is added to it."""
        return 0.0


def check_own_fields(text: str, key: str, of: str) -> None:
    """Check a condition that may only name fields of one value.

    `of`: the value, for the error.
    Raises: InvalidInput, MissionError.
    """
    # a condition on one value is decided when that value arrives: others would be of another instant
    if text and (others := parse_condition(text, VALUE).resources() - {VALUE}):
        raise InvalidInput(f"{key}: {min(others)!r}: expected fields of the value of {of} only")


class WaitForResource(Params, frozen=True):
    """Wait until a resource of the platform has a fresh value."""

    path: Path
    """Path of a board, or a pattern of several, of which one suffices: `nav/status`, `sensor/*`."""
    until: Text = ""
    """Condition on the fields of its value: `state == 'arrived'`; "" accepts any fresh value."""

    def __post_init__(self) -> None:
        """Check the pattern and the condition."""
        if self.path.startswith("/"):
            raise InvalidInput(f"path {self.path!r}: expected one of this platform, such as nav/status")
        Pattern(self.path)
        check_own_fields(self.until, "until", "the resource")


class Request(Params, frozen=True):
    """Send a request to a command, and wait for its answer."""

    path: Path
    """Path of the command: `sys/log/stats`, or `/uav2/sys/log/stats` of another platform."""
    args: dict[str, Any] | tuple[Any, ...] = ()
    """Fields of the request by name, or their values in the order of its type."""
    expect: Text = ""
    """Condition on the fields of the answer: `armed == true`; "" accepts any answer."""
    answer_s: Annotated[float, msgspec.Meta(gt=0, le=86_400)] = 10.0
    """Longest time until the answer."""

    def __post_init__(self) -> None:
        """Check the path and the condition."""
        _check_single(self.path)
        check_own_fields(self.expect, "expect", "the answer")

    @property
    def lasts_s(self) -> float:
        """Longest time until the answer."""
        return self.answer_s


class SetResource(Params, frozen=True):
    """Set a resource, or one field of it."""

    path: Path
    """Path of the resource, or of one of its fields: `nav/limits.speed_m_s`."""
    value: Any
    """New value: a number, a text, or an object of its fields."""

    def __post_init__(self) -> None:
        """Check the path."""
        _check_single(split_field(self.path)[0])


class ModuleService(Params, frozen=True):
    """Start or stop a service of the platform."""

    service: ServiceName
    """Name of the service, as its guard has it."""


class UserBreakpoint(Params, frozen=True):
    """Wait for the answer of an operator."""

    question: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
    """Question to the operator: `Ready for the launch?`."""
    wait_s: Annotated[float, msgspec.Meta(gt=0, le=86_400)] = 600.0
    """Time for the answer."""
    unanswered: Literal["continue", "stop"] = "stop"
    """What follows without an answer: `continue` completes the block, `stop` ends it with an error."""

    @property
    def lasts_s(self) -> float:
        """Time for the answer."""
        return self.wait_s


def _check_single(path: str) -> None:
    if "*" in path:
        raise InvalidInput(f"path {path!r}: a pattern; expected the path of one resource")
    Pattern(path)
