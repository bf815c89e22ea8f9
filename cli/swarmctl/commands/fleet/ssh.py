"""Commands on hosts by the OpenSSH client, with the configuration and the SSH agent of the user."""

import asyncio
import contextlib
import shlex
from asyncio.subprocess import DEVNULL, PIPE
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Final

import msgspec

from swarmctl.membership.hosts import FleetHost
from swarmware.errors import Denied, NoAnswer, SwarmError

FAILED: Final = 255
"""Exit code of `ssh` itself. Source: ssh(1), EXIT STATUS."""
ALIVE_S: Final = 5
"""Period of the checks whether the host still answers; three without an answer end the connection."""
LINE_BYTES: Final = 1 << 20
"""Maximum length of one line of output."""
_REFUSED: Final = ("permission denied", "host key verification failed", "host identification has changed")


class SshResult(msgspec.Struct, frozen=True):
    """A command that has ended on a host."""

    code: int
    stdout: bytes
    stderr: str


def command_line(host: FleetHost, words: Sequence[str], connect_s: float) -> list[str]:
    """Words of the local `ssh` for a command on a host, each quoted for the host's shell."""
    keys = host.keys
    options = {
        # no questions: many hosts are reached at once without an operator at each
        # a question of ssh would wait for an answer that nothing gives
        "BatchMode": "yes",
        "StrictHostKeyChecking": "yes",
        "ConnectTimeout": str(max(1, round(connect_s))),
        # without these a host that loses its network blocks the command until TCP gives up
        "ServerAliveInterval": str(ALIVE_S),
        "ServerAliveCountMax": "3",
        "LogLevel": "ERROR",
    }
    if keys.known_hosts:
        # the value of an option is split at blanks unless it is quoted
        options["UserKnownHostsFile"] = f'"{host.folder / keys.known_hosts}"'
        # a file of the fleet replaces the machine's, or a host of the same name would match
        options["GlobalKnownHostsFile"] = "/dev/null"
    line = ["ssh", "-T", "-p", str(keys.port), "-l", keys.user]
    for name, value in options.items():
        line += ["-o", f"{name}={value}"]
    if keys.identity:
        # without this, keys of the agent are tried first and may exhaust the server's attempts
        line += ["-o", "IdentitiesOnly=yes", "-i", str(host.folder / keys.identity)]
    raised = ["sudo", "-n", "--"] if keys.sudo else []
    # ssh joins its arguments with blanks for the remote shell, so the words are quoted here
    return [*line, "--", host.address, shlex.join([*raised, *words])]


async def run(
    host: FleetHost, words: Sequence[str], connect_s: float, stdin: bytes | None = None
) -> SshResult:
    """Run a command on a host to its end; a cancelled call ends the command.

    Raises: NoAnswer when the host is not reached, Denied when it refuses the connection or is not known.
    """
    line = command_line(host, words, connect_s)
    child = await _child(line, stdin=DEVNULL if stdin is None else PIPE)
    async with _ended(child):
        stdout, stderr = await child.communicate(stdin)
    done = SshResult(child.returncode or 0, stdout, stderr.decode("utf-8", "replace").strip())
    _check(done.code, done.stderr)
    return done


async def follow(
    host: FleetHost, words: Sequence[str], connect_s: float, on_line: Callable[[str, str], None]
) -> int:
    """Run a command on a host; `on_line` takes the name of the stream and each line. Returns its exit code.

    Raises: as `run`.
    """
    child = await _child(command_line(host, words, connect_s), stdin=DEVNULL)
    assert child.stdout is not None
    assert child.stderr is not None
    last = [""]

    async def pass_on(name: str, stream: asyncio.StreamReader) -> None:
        while data := await _line(stream):
            text = data.decode("utf-8", "replace").rstrip("\r\n")
            if name == "stderr":
                last[0] = text
            on_line(name, text)

    async with _ended(child):
        await asyncio.gather(pass_on("stdout", child.stdout), pass_on("stderr", child.stderr))
        code = await child.wait()
    _check(code, last[0])
    return code


async def _line(stream: asyncio.StreamReader) -> bytes:
    """The next line, or the next LINE_BYTES of a longer line."""
    try:
        return await stream.readuntil()
    except asyncio.IncompleteReadError as end:  # the last line without a line feed
        return end.partial
    except asyncio.LimitOverrunError as long:
        # a line longer than the buffer is passed on in parts, since waiting for its end would block
        return await stream.read(long.consumed)


async def _child(line: list[str], stdin: int) -> asyncio.subprocess.Process:
    try:
        return await asyncio.create_subprocess_exec(
            *line, stdin=stdin, stdout=PIPE, stderr=PIPE, limit=LINE_BYTES
        )
    except FileNotFoundError as error:
        raise SwarmError("ssh: no such program; expected the OpenSSH client (openssh-client)") from error


@contextlib.asynccontextmanager
async def _ended(child: asyncio.subprocess.Process) -> AsyncIterator[None]:
    try:
        yield
    finally:
        if child.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                child.terminate()
            await child.wait()


def _check(code: int, stderr: str) -> None:
    if code != FAILED:
        return
    text = stderr.splitlines()[-1] if stderr else "ssh failed without a message"
    if any(word in stderr.lower() for word in _REFUSED):
        raise Denied(f"{text}; expected a known host key and an accepted SSH key")
    raise NoAnswer(text)
