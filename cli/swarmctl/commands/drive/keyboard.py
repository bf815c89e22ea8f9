"""Keys of a terminal as set-points: a key acts while it is held, which a terminal shows by repeating it."""

import re
from typing import Final, NamedTuple

from swarmware.types.vehicle import Setpoint

FIRST_S: Final = 0.7
"""Time for which a key acts that is pressed once: terminals repeat a held key after 0.25 to 0.66 s."""
REPEAT_S: Final = 0.25
"""Time for which a repeated key acts: terminals repeat it 10 to 30 times a second."""

END_KEYS: Final = frozenset({"x", "\x03", "\x04"})
"""x, Ctrl-C, Ctrl-D."""
STOP_KEYS: Final = frozenset({" ", "\x1b[O"})
"""Space, and the report of a terminal that it has lost the focus."""

_ARROWS: Final = {"\x1b[A": "w", "\x1b[B": "s", "\x1b[D": "a", "\x1b[C": "d"}
_KEY: Final = re.compile(r"\x1b\[[0-9;]*[A-Za-z~]|\x1bO[A-D]|.", re.DOTALL)


class Rates(NamedTuple):
    """Speeds that the keys command."""

    speed_m_s: float
    climb_m_s: float
    turn_rad_s: float


class _Pressed(NamedTuple):
    at_s: float
    until_s: float


_AXES: Final[dict[str, tuple[str, int]]] = {
    "w": ("forward", 1),
    "s": ("forward", -1),
    "a": ("left", 1),
    "d": ("left", -1),
    "r": ("up", 1),
    "f": ("up", -1),
    "q": ("turn", 1),
    "e": ("turn", -1),
}
"""Axis and sign of each key."""


def keys_in(text: str) -> list[str]:
    """The keys in the bytes of a terminal; arrows count as w, s, a and d."""
    found = [
        key.replace("\x1bO", "\x1b[") if len(key) == 3 and key[2] in "ABCD" else key
        for key in _KEY.findall(text)
    ]
    return [_ARROWS.get(key, key if key.startswith("\x1b") else key.lower()) for key in found]


class Keyboard:
    """Which keys act at present; time is an argument."""

    def __init__(self, rates: Rates, *, sideways: bool = True) -> None:
        """`sideways`: the vehicle can move to its side; of another one a and d turn it."""
        self._rates = rates
        self._sideways = sideways
        self._pressed: dict[str, _Pressed] = {}
        self.ended = False
        """Whether the operator has released the vehicle."""

    def on_text(self, text: str, now_s: float) -> None:
        """Takes what the terminal sends."""
        for key in keys_in(text):
            if key in END_KEYS:
                self.ended = True
            elif key in STOP_KEYS:
                self._pressed.clear()
            elif key in _AXES:
                former = self._pressed.get(key)
                # a repetition proves that the key is held, so a shorter time suffices
                repeated = former is not None and now_s <= former.until_s
                hold_s = REPEAT_S if repeated else FIRST_S
                axis = _AXES[key][0]
                # the newest key of an axis wins: a terminal does not report that the other was released
                for other in [one for one in self._pressed if _AXES[one][0] == axis and one != key]:
                    del self._pressed[other]
                self._pressed[key] = _Pressed(now_s, now_s + hold_s)

    def setpoint(self, now_s: float) -> Setpoint:
        """The set-point that the held keys command."""
        axes = dict.fromkeys(("forward", "left", "up", "turn"), 0)
        for key, pressed in self._pressed.items():
            if now_s <= pressed.until_s:
                axis, sign = _AXES[key]
                axes[axis] = sign
        turn = axes["turn"]
        # a vehicle with wheels turns by the keys that move another one aside
        if not self._sideways:
            turn, axes["left"], axes["up"] = turn or axes["left"], 0, 0
        speed_m_s, climb_m_s, turn_rad_s = self._rates
        return Setpoint(
            axes["forward"] * speed_m_s, axes["left"] * speed_m_s, axes["up"] * climb_m_s, turn * turn_rad_s
        )
