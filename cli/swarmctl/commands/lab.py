"""`swarmctl lab`: a whole swarm of real processes on this machine."""

import click

from swarmctl.lazy import Group


@click.group(cls=Group)
def cmd() -> None:
    """Run a whole swarm on this machine.

    Example: swarmctl lab run formation --nodes 4
    """


@cmd.command()
def run() -> None:
    """x"""
