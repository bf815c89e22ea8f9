"""Arguments and options with a secret, which can come from a file or stdin instead of the command line."""

import sys
from pathlib import Path
from typing import Any, Final

import click

LIMIT_BYTES: Final = 4096
"""A token has some 80 characters, an address of a database a few hundred."""
FROM_FILE: Final = "@"
STDIN: Final = "-"


class SecretText(click.ParamType):  # type: ignore[type-arg]  # 8.1 is not generic
    """A text that should not stand in the list of processes.

    `@FILE` reads it from a file, `@-` the first line of stdin.
    """

    name = "text"

    def __init__(self, *, stdin: str = f"{FROM_FILE}{STDIN}") -> None:
        """`stdin`: a further word that means stdin, such as `-`, where it has no other meaning."""
        self._stdin = {stdin, f"{FROM_FILE}{STDIN}"}

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The secret: the argument, the content of its file, or a line of stdin, without blanks around it.

        BadParameter for a file that cannot be read, is empty or too large.
        """
        if value in self._stdin:
            return self._checked(sys.stdin.buffer.readline(LIMIT_BYTES + 1), "stdin", param, ctx)
        if not value.startswith(FROM_FILE):
            return value
        path = Path(value.removeprefix(FROM_FILE))
        try:
            with path.open("rb") as file:
                data = file.read(LIMIT_BYTES + 1)
        except OSError as error:
            self.fail(f"{path}: {error.strerror}; expected a file with the text", param, ctx)
        return self._checked(data, str(path), param, ctx)

    def _checked(
        self, data: bytes, where: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        try:
            text = data.decode("utf-8-sig").strip()  # a byte order mark is skipped
        except UnicodeDecodeError:
            self.fail(f"{where}: not UTF-8; expected the text", param, ctx)
        if len(data) > LIMIT_BYTES:
            self.fail(f"{where}: more than {LIMIT_BYTES} bytes; expected the text alone", param, ctx)
        if not text:
            self.fail(f"{where}: empty; expected the text", param, ctx)
        return text


SECRET: Final = SecretText()
TOKEN: Final = SecretText(stdin=STDIN)
