"""Steps on a host: the agent of the installed wheel by SSH, and the installation of that wheel."""

import hashlib
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.commands.fleet import ssh
from swarmctl.commands.fleet.plan import ABSENT, HostStatus
from swarmctl.membership.hosts import FleetHost, digest, files
from swarmware.errors import KINDS, Conflict, InvalidInput, SwarmError

AGENT: Final = "swarmctl.commands.fleet.agent"
NOT_INSTALLED: Final = 61
"""Exit code of the script below when the environment is missing or has no agent."""
RUNS_WITHOUT_AGENT: Final = 62
"""Exit code of the script below when there is no agent, and daemons of the environment run."""

_PROGRAM: Final = f"""import sys
try:
    from {AGENT} import main
except ModuleNotFoundError as error:
    sys.exit({NOT_INSTALLED} if (error.name or "").startswith("swarm") else str(error))
sys.exit(main(sys.argv[1:]))
"""
# the words of all processes are compared with a path that this script and `grep` do not have in theirs
_CALL: Final = (
    f'test -x "$1/bin/python" || exit {NOT_INSTALLED}; "$1/bin/python" -c "$2" "$3"; code=$?; '
    f"if test $code = {NOT_INSTALLED} && "
    'printf "%s/bin/swarmd\\n" "$1" | grep -qsaFf - /proc/[0-9]*/cmdline; '
    f"then exit {RUNS_WITHOUT_AGENT}; fi; exit $code"
)
# checked before the node is stopped: whether its environment can be written
_UPLOAD: Final = (
    'set -e; umask 022; wheels="$1/wheel"; '
    'if test -x "$1/bin/python"; then '
    '  site="$("$1/bin/python" -c "import sysconfig; print(sysconfig.get_path(\'purelib\'))")"; '
    '  touch "$site/.swarm-written" 2>/dev/null || '
    '  { echo "$site: cannot be written; expected an environment that this user may change" >&2; exit 1; }; '
    '  rm -f "$site/.swarm-written"; '
    "fi; "
    'mkdir -p "$wheels"; cat >"$wheels/.received"; '
    'printf "%s  %s\n" "$3" "$wheels/.received" | sha256sum --check --status || '
    '{ rm -f "$wheels/.received"; echo "the wheel arrived incomplete" >&2; exit 1; }; '
    'if test -f "$wheels/$2"; then mkdir -p "$wheels/former"; mv -f "$wheels/$2" "$wheels/former/$2"; fi; '
    'mv -f "$wheels/.received" "$wheels/$2"'
)
# a wheel of the same version is not "satisfied already": it is installed again, without its dependencies
_INSTALL: Final = (
    'umask 022; dir="$1"; wheel="$1/wheel/$2"; sum="$3"; shift 3; '
    '"$dir/bin/python" -m pip --version >/dev/null 2>&1 || python3 -m venv "$dir" >&2 || exit 1; '
    'pip() { "$dir/bin/python" -m pip --quiet --disable-pip-version-check --no-input install "$@" 2>&1; }; '
    'renew() { pip --force-reinstall --no-deps "$@"; }; '
    'if text="$(pip "$@" "$wheel" && renew "$@" "$wheel")"; then '
    '  echo "$sum" >"$dir/wheel/.sum" && mv -f "$dir/wheel/.sum" "$dir/wheel/installed"; exit; '
    "fi; "
    'text="$(printf "%s\n" "$text" | tail -n 1)"; '
    'for kept in "$dir"/wheel/*.whl "$dir"/wheel/former/*.whl; do '
    '  printf "%s  %s\n" "$(cat "$dir/wheel/installed" 2>/dev/null)" "$kept" | sha256sum --check --status '
    "  2>/dev/null || continue; "
    '  if renew "$@" "$kept" >/dev/null; then echo "$text; the former wheel is installed again" >&2; '
    '  else echo "$text; the former wheel cannot be installed either: $kept" >&2; fi; exit 1; '
    "done; "
    'echo "$text" >&2; exit 1'
)


class Wheel(msgspec.Struct, frozen=True):
    """A wheel of Swarmware on the operator's machine."""

    name: str
    data: bytes
    sum: str
    """SHA-256."""


def read_wheel(path: Path) -> Wheel:
    """Read a wheel.

    Raises: InvalidInput when it is not one, OSError.
    """
    data = path.read_bytes()
    # a wheel is a zip file, whose first bytes are PK
    if path.suffix != ".whl" or not data.startswith(b"PK"):
        raise InvalidInput(f"file {path}: not a wheel; expected the swarmware-*.whl of `make dist`")
    return Wheel(path.name, data, hashlib.sha256(data).hexdigest())


class Remote:
    """A host and the actions on it."""

    def __init__(self, host: FleetHost, connect_s: float, wait_s: float, *, force: bool = False) -> None:
        """`wait_s`: maximum wait for the start or end of its node; `force`: also of an armed vehicle."""
        self.host = host
        self._connect_s = connect_s
        self._wait_s = wait_s
        self._force = force

    async def status(self) -> HostStatus:
        """State of the host and its node.

        Raises: as `ssh.run`; SwarmError from the host.
        """
        return await self._order("status")

    async def push(self) -> HostStatus:
        """Bring the files of the host, which are checked there before one is replaced.

        Raises: as `status`; OSError and InvalidInput for the files here.
        """
        content = files(self.host)
        return await self._order("push", msgspec.msgpack.encode(content), digest=digest(content))

    async def start(self) -> HostStatus:
        """Start the node and wait until it answers.

        Raises: as `status`.
        """
        return await self._order("start")

    async def stop(self, *, resume: bool) -> HostStatus:
        """Stop the node; `resume`: for an upgrade, which starts it again also when it is repeated.

        Raises: as `status`; Denied for an armed vehicle unless `force`.
        """
        return await self._order("stop", resume=resume, force=self._force)

    async def upload(self, wheel: Wheel) -> None:
        """Bring the wheel to the host, without installing it.

        Raises: as `ssh.run`; SwarmError from the host.
        """
        await self._script(_UPLOAD, self.host.keys.prefix, wheel.name, wheel.sum, stdin=wheel.data)

    async def install(self, wheel: Wheel) -> None:
        """Install the wheel in the environment of the host, which is created if it is missing.

        Raises: as `upload`.
        """
        keys = self.host.keys
        await self._script(_INSTALL, keys.prefix, wheel.name, wheel.sum, *keys.pip)

    async def _script(self, script: str, *words: str, stdin: bytes | None = None) -> None:
        done = await ssh.run(self.host, ["sh", "-c", script, "sh", *words], self._connect_s, stdin)
        if done.code:
            raise SwarmError(_last(done.stderr) or f"exit code {done.code}")

    async def _order(self, verb: str, stdin: bytes | None = None, **more: object) -> HostStatus:
        keys = self.host.keys
        order = {
            "verb": verb,
            "config_dir": keys.config_dir,
            "prefix": keys.prefix,
            "supervisor": keys.supervisor,
            "unit": keys.unit,
            "wait_s": self._wait_s,
            **more,
        }
        words = ["sh", "-c", _CALL, "sh", keys.prefix, _PROGRAM, msgspec.json.encode(order).decode()]
        done = await ssh.run(self.host, words, self._connect_s, stdin)
        if done.code == NOT_INSTALLED:
            return ABSENT
        if done.code == RUNS_WITHOUT_AGENT:
            raise Conflict(
                f"a node runs from {keys.prefix}, whose version does not know `fleet`, so that it cannot be"
                " asked whether it flies; expected it to be ended there (systemctl stop swarm.target"
                " 'swarmd@*', or end of `swarmd node`)"
            )
        return status_of(done)


def status_of(done: ssh.SshResult) -> HostStatus:
    """The status that the agent printed.

    Raises: SwarmError that it reported, of its class; or with the end of stderr when it printed none.
    """
    try:
        found = msgspec.json.decode(done.stdout)
        if "error" in found:
            raise _raised(str(found["error"]), int(found["exit_code"]))
        return msgspec.convert(found, HostStatus)
    except (msgspec.DecodeError, TypeError, KeyError, ValueError) as error:
        # InvalidInput and others are ValueErrors as well, and carry the error of the host
        if isinstance(error, SwarmError):
            raise
        text = _last(done.stderr) or f"exit code {done.code}"
        raise SwarmError(f"the agent on the host did not answer: {text}") from error


def _raised(text: str, code: int) -> SwarmError:
    """An error with the exit code that it had on the host."""
    kind = next((kind for kind in KINDS.values() if kind.exit_code == code), SwarmError)
    return kind(text)


def _last(text: str) -> str:
    return text.splitlines()[-1] if text else ""
