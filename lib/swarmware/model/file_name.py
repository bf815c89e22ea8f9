"""The name of a file that comes from outside: from another platform, a file of a user, or a record."""

import re
from typing import Annotated, Final

import msgspec

_NAME: Final = r"[A-Za-z0-9_][A-Za-z0-9._+-]{0,99}"
_END: Final = r"(?!\n)$"
"""End of a pattern, in Python and in JSON Schema: `$` of Python also matches before a last line break."""
_WHOLE: Final = re.compile(rf"{_NAME}\Z")

FileName = Annotated[str, msgspec.Meta(pattern=rf"^{_NAME}{_END}")]
"""Name of a file in a folder that the receiver knows: no folders, not hidden."""
MemberFileName = Annotated[str, msgspec.Meta(pattern=rf"^{_NAME}(/mission\.json)?{_END}")]
"""A file name, or `<id>/mission.json`: the file in the folder of a mission's member."""
OptionalFileName = Annotated[str, msgspec.Meta(pattern=rf"^({_NAME})?{_END}")]
"""A file name, or an empty text where none is meant."""


def is_file_name(text: str) -> bool:
    """Whether the text names a file in a folder, and leads to no other folder."""
    return _WHOLE.match(text) is not None
