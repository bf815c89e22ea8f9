"""Questions before something that cannot be taken back; a script answers them by options."""

import sys

import click


def confirm(yes: bool, what: str) -> None:
    """Goes on when the operator says yes, on the command line or now.

    Raises: UsageError where nobody can be asked, Abort after a no.
    """
    if yes:
        return
    if not sys.stdin.isatty():
        raise click.UsageError(f"{what}: expected --yes, because nobody can be asked here")
    click.confirm(f"{what}. Go on?", abort=True, err=True)


def confirm_by_name(name: str, given: str, what: str) -> None:
    """Goes on when the name was typed a second time, in `--confirm` or now.

    Raises: UsageError when it is another one, or nobody can be asked.
    """
    if not given:
        if not sys.stdin.isatty():
            raise click.UsageError(f"{what}: expected --confirm {name}, because nobody can be asked here")
        given = click.prompt(f"{what}. Type {name} to go on", err=True)
    if given != name:
        raise click.UsageError(f"{what}: confirmed by {given!r}; expected the same name, {name!r}")
