"""`swarmctl`: one command for the whole swarm."""

import errno
import io
import os
import stat
import sys
from typing import Final, TextIO

import click

from swarmctl.commandline.lazy import Command, Lazy, LazyGroup
from swarmctl.commandline.settings import PREFIX, CliSettings, Nodes, settings, wants_structured
from swarmctl.commandline.shared_options import shared_options
from swarmctl.terminal.size import terminal_columns
from swarmware import __version__
from swarmware.errors import Denied, NotFound, SwarmError

_NAME: Final = "swarmctl"
_COMPLETE: Final = "_SWARMCTL_COMPLETE"
"""Environment variable by which a shell requests completions."""
_ZSH_COMPINIT: Final = "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }"
"""Start of zsh's completion, which defines `compdef`, for shells whose configuration does not start it."""
INTERRUPTED: Final = 130
"""Exit code after Ctrl-C (128 + SIGINT)."""

HELP_COLUMNS: Final = 110
"""Maximum width of a help text."""
LINE_CHARACTERS: Final = 2000
"""Maximum characters of a line of an error; the middle of a longer line, such as a path, is left out."""
_KEPT: Final = 800
"""Characters kept at each end of a long line: it begins with the place and ends with the expectation."""

_WRITE_FAILURES: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})

SECTIONS: Final[dict[str, dict[str, Lazy]]] = {
    "Fly": {
        "takeoff": Lazy("swarmctl.commands.manoeuvre.command:takeoff", "Arm vehicles, climb and hold."),
        "goto": Lazy("swarmctl.commands.manoeuvre.command:goto", "Move vehicles to a place."),
        "hold": Lazy("swarmctl.commands.manoeuvre.command:hold", "Stop vehicles and hold their positions."),
        "land": Lazy("swarmctl.commands.manoeuvre.command:land", "Land vehicles at their positions."),
        "return": Lazy(
            "swarmctl.commands.manoeuvre.command:return_", "Return vehicles to their start and land them."
        ),
        "drive": Lazy("swarmctl.commands.drive.command:drive", "Drive one vehicle by hand."),
        "arm": Lazy("swarmctl.commands.motors.command:arm", "Arm vehicles on the ground."),
        "disarm": Lazy("swarmctl.commands.motors.command:disarm", "Disarm vehicles on the ground."),
        "kill": Lazy(
            "swarmctl.commands.motors.command:kill", "Stop the motors of one vehicle, also in the air."
        ),
    },
    "Missions": {
        "mission": Lazy("swarmctl.commands.mission.command:cmd", "Check, start, watch and abort missions."),
    },
    "Inspect": {
        "node": Lazy("swarmctl.commands.node.command:cmd", "Nodes of the swarm."),
        "app": Lazy("swarmctl.commands.app.command:cmd", "Applications that run on the nodes."),
        "health": Lazy("swarmctl.commands.health.command:cmd", "State and faults of the nodes."),
        "hal": Lazy("swarmctl.commands.hal.command:cmd", "Drivers of sensors and actuators."),
        "time": Lazy("swarmctl.commands.time.command:cmd", "Clock conversions between nodes."),
        "doctor": Lazy(
            "swarmctl.commands.doctor.command:cmd", "Check this machine and its node for problems."
        ),
    },
    "Network": {
        "topo": Lazy("swarmctl.commands.topo.command:cmd", "Links of the swarm as a graph."),
        "link": Lazy("swarmctl.commands.link.command:cmd", "Links and their quality."),
        "traffic": Lazy(
            "swarmctl.commands.traffic.command:cmd", "Rates, channels and costs of the values between nodes."
        ),
    },
    "Data": {
        "tree": Lazy("swarmctl.commands.tree.command:cmd", "Resources: list, read, set and watch them."),
        "wait": Lazy("swarmctl.commands.wait.command:wait", "Wait until a condition on a resource holds."),
        "call": Lazy(
            "swarmctl.commands.call.command:call", "Send a request to a command and print the answer."
        ),
        "pub": Lazy("swarmctl.commands.pub.command:pub", "Publish a value as a resource of the joined node."),
        "log": Lazy("swarmctl.commands.log.command:cmd", "Query, follow and export log entries."),
        "file": Lazy("swarmctl.commands.file.command:cmd", "Send files to nodes and get files from them."),
        "video": Lazy("swarmctl.commands.video.command:cmd", "Video of cameras and recordings."),
    },
    "Set up": {
        "host": Lazy(
            "swarmctl.commands.host.command:cmd", "Set this computer up for a node, or remove the node."
        ),
        "keys": Lazy(
            "swarmctl.commands.keys.command:cmd", "Keys of the swarm: root, members and invitations."
        ),
        "config": Lazy("swarmctl.commands.config.command:cmd", "Settings of the nodes, and their origin."),
        "fleet": Lazy("swarmctl.commands.fleet.command:cmd", "Nodes on other hosts, over SSH."),
        "completion": Lazy("swarmctl.main:completion", "Print the completion script of a shell."),
    },
    "Develop": {
        "lab": Lazy("swarmlab.command:cmd", "Run a whole swarm on this machine."),
        "new": Lazy(
            "swarmctl.commands.new.command:cmd", "Create the first version of a module, driver or service."
        ),
        "docs": Lazy("swarmctl.commands.docs.command:cmd", "Open the documentation in a browser."),
    },
}
"""Commands in the sections of the help, with their modules, which are imported at a call."""


@click.group(
    cls=LazyGroup,
    sections=SECTIONS,
    context_settings={
        "auto_envvar_prefix": PREFIX,
        "help_option_names": ["-h", "--help"],
        "max_content_width": HELP_COLUMNS,
    },
    epilog="Every option is also read from the environment: SWARMCTL_NODE, SWARMCTL_LAB, SWARMCTL_JSON …"
    " Like swarmd and modules, it takes the configuration folder from SWARM_CONFIG.",
)
@click.version_option(__version__, prog_name="swarmctl", message="%(prog)s %(version)s")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Operate a swarm of unmanned vehicles with one command.

    Example: swarmctl lab run formation --nodes 4
    """
    ctx.obj = settings(ctx)


cli.params += shared_options(set())


@click.command(cls=Command, nodes=Nodes.NONE)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of a shell.

    Example: eval "$(swarmctl completion bash)"
    """
    from click.shell_completion import get_completion_class

    completer = get_completion_class(shell)
    if completer is None:
        raise click.UsageError(f"no completion for {shell}")
    if shell == "zsh":
        click.echo(_ZSH_COMPINIT)
    click.echo(completer(cli, {}, _NAME, _COMPLETE).source())


def main(args: list[str] | None = None) -> int:
    """Runs one command; every error becomes one line on stderr and an exit code (share/doc/cli.md)."""
    _open_closed_streams()
    if _COMPLETE in os.environ:
        # click answers the shell and exits
        cli.main(args, prog_name=_NAME, complete_var=_COMPLETE)
    words = sys.argv[1:] if args is None else args
    try:
        # not cli.main(): it reports a reader that has closed the pipe (EPIPE) as a failure
        with cli.make_context(_NAME, list(words), obj=CliSettings(), terminal_width=_help_width()) as ctx:
            cli.invoke(ctx)
        sys.stdout.flush()
    except click.exceptions.Exit as done:
        return done.exit_code
    except click.exceptions.Abort:
        return INTERRUPTED
    except click.ClickException as error:
        if wants_structured(words, os.environ):
            return _fail(words, error.format_message(), error.exit_code)
        shown = io.StringIO()
        error.show(shown)
        _print_error(shown.getvalue().rstrip())
        return error.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        _discard_stdout()  # the reader has closed the pipe
        return 0
    except SwarmError as error:
        return _report(words, error)
    except ExceptionGroup as group:
        # from a TaskGroup: the operator gets one error, not a tree of them
        return _report(words, _first(group))
    except OSError as error:
        place = _place(error)
        return _report(words, _of_file(error, place) if place else error)
    except Exception as error:  # noqa: BLE001 - the outermost place: a bug is one line and exit code 1
        return _report(words, error)
    return 0


def _help_width() -> int:
    """Width that click would find itself, with `shutil`."""
    return max(min(terminal_columns(), HELP_COLUMNS) - 2, 50)


def _open_closed_streams() -> None:
    """Opens the null device for a stdout or stderr that the caller has closed (`>&-`)."""
    if sys.stdout is None:
        sys.stdout = _null_device()
    if sys.stderr is None:
        sys.stderr = _null_device()


def _null_device() -> TextIO:
    return os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")


def _discard_stdout() -> None:
    """Discards buffered output, which the interpreter would try to write again at its exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _place(error: OSError) -> str:
    """The file of an error, stdout for a failed write without a file, or "" for any other call.

    An unnamed full device must be stdout: commands name the files that they write (`filewriter.naming`).
    """
    if error.filename is not None:
        return f"file {error.filename}"
    if error.errno not in _WRITE_FAILURES:
        return ""
    mode = os.fstat(sys.stdout.fileno()).st_mode
    if not stat.S_ISREG(mode) and (not stat.S_ISCHR(mode) or sys.stdout.isatty()):
        return ""
    _discard_stdout()
    return "stdout"


def _of_file(error: OSError, place: str) -> SwarmError:
    """Error with the proper exit code for a file of an operator that cannot be read or written."""
    text = f"{place}: {(error.strerror or str(error)).lower()}"
    if isinstance(error, FileNotFoundError):
        return NotFound(f"{text}; expected an existing file or folder")
    if isinstance(error, PermissionError):
        return Denied(f"{text}; expected permission to access it")
    return SwarmError(text)


def _first(group: BaseExceptionGroup[BaseException]) -> BaseException:
    """The most relevant error of a group: the first SwarmError, else the first error."""
    leaves = [_first(e) if isinstance(e, BaseExceptionGroup) else e for e in group.exceptions]
    return next((error for error in leaves if isinstance(error, SwarmError)), leaves[0])


def _report(words: list[str], error: BaseException) -> int:
    if os.environ.get(f"{PREFIX}_TRACEBACK"):
        import traceback

        traceback.print_exception(error)
    if isinstance(error, SwarmError):
        return _fail(words, str(error), error.exit_code)
    where = f"; {PREFIX}_TRACEBACK=1 shows where"
    return _fail(words, f"{type(error).__name__}: {error}{where}", 1)


def _fail(words: list[str], text: str, code: int) -> int:
    """Prints an error in the form of the result, and returns the exit code."""
    if wants_structured(words, os.environ):
        from swarmctl.terminal.output import json_line

        print(json_line({"error": _shortened(text), "exit_code": code}), file=sys.stderr)
    else:
        _print_error(f"error: {text}")
    return code


def _shortened(text: str) -> str:
    """The text without the middle of very long lines, because a refused argument may be a whole file."""
    lines = [
        line
        if len(line) <= LINE_CHARACTERS
        else f"{line[:_KEPT]} … {len(line) - 2 * _KEPT} characters … {line[-_KEPT:]}"
        for line in text.split("\n")
    ]
    return "\n".join(lines)


def _print_error(text: str) -> None:
    from swarmctl.terminal.wrapping import fitted_text, terminal_width
    from swarmware.model.visible import visible_lines

    print(fitted_text(visible_lines(_shortened(text)), terminal_width(sys.stderr)), file=sys.stderr)
