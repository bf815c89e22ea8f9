"""Confirmation before something irreversible; scripts give it as an option."""

import sys

import click


def confirm(yes: bool, what: str) -> None:
    """Returns when the operator confirms, by option or at the prompt.

    Raises: UsageError without a terminal, Abort after a refusal.
    """
    if yes:
        return
    if not sys.stdin.isatty():
        raise click.UsageError(f"{what}: expected --yes, because stdin is not a terminal")
    click.confirm(f"{what}. Continue?", abort=True, err=True)


def confirm_by_name(name: str, given: str, what: str) -> None:
    """Returns when the name was typed a second time, in `--confirm` or at the prompt.

    Raises: UsageError when it differs, or without a terminal.
    """
    if not given:
        if not sys.stdin.isatty():
            raise click.UsageError(f"{what}: expected --confirm {name}, because stdin is not a terminal")
        given = click.prompt(f"{what}. Type {name} to continue", err=True)
    if given != name:
        raise click.UsageError(f"{what}: confirmed by {given!r}; expected the same name, {name!r}")
