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
        raise click.UsageError(f"{what}: expected --yes, because nobody can be asked here")
    click.confirm(f"{what}. Go on?", abort=True, err=True)


def confirm_by_name(name: str, given: str, what: str) -> None:
    """Returns when the name was typed a second time, in `--confirm` or at the prompt.

    Raises: UsageError when it differs, or without a terminal.
    """
    if not given:
        if not sys.stdin.isatty():
            raise click.UsageError(f"{what}: expected --confirm {name}, because nobody can be asked here")
        given = click.prompt(f"{what}. Type {name} to go on", err=True)
    if given != name:
        raise click.UsageError(f"{what}: confirmed by {given!r}; expected the same name, {name!r}")
