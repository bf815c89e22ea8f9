"""Control characters of texts from outside as escape sequences: readers see them, terminals ignore them."""

import re
from typing import Final

_HIDDEN_SETS: Final = (
    "\x00-\x1f\x7f-\x9f"  # C0, DEL, C1: 0x9b alone begins a control sequence
    # direction, joiners, separators of lines, invisible characters
    "\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\U0001d173-\U0001d17a\U000e0000-\U000e007f"
    "\ud800-\udfff"  # bytes of an argument that are not UTF-8; no terminal can print them
)
HIDDEN: Final = re.compile(f"[{_HIDDEN_SETS}]")
"""Characters that a terminal obeys, that change the order of others, or that have no width.

Source: Unicode 15, categories Cc, Zl, Zp the characters of Cf that are not part of a script, and Cs.
"""
_NAMED: Final = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}
_LINES: Final = re.compile(f"(?!\n){HIDDEN.pattern}")


def visible(text: str) -> str:
    """A text on one line, its control characters as `\\x1b`, `\\n` or `\\u202e`."""
    return text if text.isprintable() else HIDDEN.sub(_escape, text)


def visible_lines(text: str) -> str:
    """As `visible`, for a text of several lines."""
    return text if text.isprintable() else _LINES.sub(_escape, text)


def _escape(found: re.Match[str]) -> str:
    char = found[0]
    code = ord(char)
    if code < 0x100:
        return _NAMED.get(char) or f"\\x{code:02x}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def json_escaped(text: str) -> str:
    """JSON with `\\u009b` for each control character: outside of strings it has only line breaks."""
    return text if text.isprintable() else _LINES.sub(_json_escape, text)


def _json_escape(found: re.Match[str]) -> str:
    data = found[0].encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{data[at]:02x}{data[at + 1]:02x}" for at in range(0, len(data), 2))
