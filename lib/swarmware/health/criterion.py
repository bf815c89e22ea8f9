"""Criteria for common checks: limits with hysteresis. Any function from data to a state is a criterion."""

import math

from swarmware.errors import InvalidInput
from swarmware.types.health import Level


class Below:
    """`warn` below one limit, `error` below a lower one; cleared `hysteresis` beyond the limit.

    The names of the states are the levels, so that `levels` need not be given.
    """

    def __init__(
        self, *, warn: float | None = None, error: float | None = None, hysteresis: float = 0.0
    ) -> None:
        if warn is None and error is None:
            raise InvalidInput("criterion: neither warn nor error; expected a limit")
        self._warn = warn
        self._error = error
        self._hysteresis = hysteresis
        self._state: Level = "ok"

    def __call__(self, value: float) -> Level:
        """The state for a value; NaN is an error: the value was not measured."""
        error_at = self._limit(self._error, self._state == "error")
        warn_at = self._limit(self._warn, self._state in {"warn", "error"})
        if math.isnan(value) or (error_at is not None and value < error_at):
            self._state = "error"
        elif warn_at is not None and value < warn_at:
            self._state = "warn"
        else:
            self._state = "ok"
        return self._state

    def _limit(self, limit: float | None, inside: bool) -> float | None:
        return None if limit is None else limit + (self._hysteresis if inside else 0.0)


class Above:
    """`warn` above one limit, `error` above a higher one; cleared `hysteresis` beyond the limit."""

    def __init__(
        self, *, warn: float | None = None, error: float | None = None, hysteresis: float = 0.0
    ) -> None:
        self._below = Below(
            warn=None if warn is None else -warn,
            error=None if error is None else -error,
            hysteresis=hysteresis,
        )

    def __call__(self, value: float) -> str:
        """The state for a value."""
        return self._below(-value)
