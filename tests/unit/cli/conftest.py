"""What tests of commands share."""

import sys
from types import ModuleType

import click
import pytest

from swarmctl import main as swarmctl
from swarmctl.commandline.lazy import Group, Lazy
from swarmctl.commandline.settings import settings
from swarmware import errors


@pytest.fixture
def probe(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A command group `probe` of the test, reached through the table as every other."""
    module = ModuleType("swarmctl_probe")

    @click.group(cls=Group)
    def cmd() -> None:
        """Probe."""

    @cmd.command()
    @click.option("--rate", type=float, default=1.0)
    @click.pass_context
    def show(ctx: click.Context, rate: float) -> None:
        """Print the settings."""
        module.seen = settings(ctx)  # type: ignore[attr-defined]
        module.rate = rate  # type: ignore[attr-defined]

    @cmd.command()
    @click.argument("kind")
    def fail(kind: str) -> None:
        """Raise."""
        if kind == "group":
            raise ExceptionGroup("tasks", [ValueError("x"), ExceptionGroup("y", [errors.NotFound("inner")])])
        if kind in errors.KINDS:
            raise errors.from_kind(kind, "nav/pose (uav3): gone; expected alive")
        raise {"interrupt": KeyboardInterrupt, "abort": click.Abort, "bug": ZeroDivisionError}[kind]("oh")

    @cmd.command()
    @click.pass_context
    def partly(ctx: click.Context) -> None:
        """Say that some of it is missing."""
        ctx.exit(3)

    module.cmd = cmd  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "swarmctl_probe", module)
    monkeypatch.setitem(swarmctl.SECTIONS["Develop"], "probe", Lazy("swarmctl_probe:cmd", "Probe."))
    return module
