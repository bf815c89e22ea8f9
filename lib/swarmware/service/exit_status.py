"""Exit status of a process, on the wire between processes and as text for operators."""

from __future__ import annotations

from swarmware.footprint.plain import signal

UNKNOWN = "gone"
"""Text of an unknown exit status: only the parent of a process receives it."""


class ExitStatus:
    """Code of an exit, or number of the signal that ended the process; neither when it is unknown.

    Not a Struct: the parent of a node uses it, and does not import msgspec.
    """

    __slots__ = ("code", "signal")

    def __init__(self, *, code: int | None = None, signal: int | None = None) -> None:
        self.code = code
        self.signal = signal

    @classmethod
    def parse(cls, text: str) -> ExitStatus:
        """The inverse of `str`; unknown for any other text."""
        how, _, number = text.partition(" ")
        if not (number.isascii() and number.isdigit() and len(number) < 10):
            return cls()
        if how == "exit":
            return cls(code=int(number))
        return cls(signal=int(number)) if how == "signal" else cls()

    @property
    def known(self) -> bool:
        """Whether the exit status is known."""
        return self.code is not None or self.signal is not None

    @property
    def killed(self) -> bool:
        """Whether SIGKILL ended the process, which says nothing about the process itself."""
        return self.signal == signal.SIGKILL

    def __str__(self) -> str:
        if self.code is not None:
            return f"exit {self.code}"
        return UNKNOWN if self.signal is None else f"signal {self.signal}"

    def __repr__(self) -> str:
        return f"ExitStatus({self})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ExitStatus) and (self.code, self.signal) == (other.code, other.signal)

    def __hash__(self) -> int:
        return hash((self.code, self.signal))
