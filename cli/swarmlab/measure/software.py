"""The software of a run: versions of the libraries, and the commit of a checkout."""

import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

import swarmware

LIBRARIES: Final = ("pyzmq", "uvloop", "msgspec", "msgpack", "pynacl", "mcap", "numpy")
"""Libraries on which measured figures depend."""
GIT_S: Final = 5.0
"""Time-out of git, for a checkout on a slow network file system."""


def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that are installed."""
    found = {"Python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def commit(package: Path | None = None) -> str:
    """Commit of the sources, with -dirty where files differ, or "" without git or outside of a checkout."""
    package = package or Path(swarmware.__file__).parent
    # an installed package may lie in the checkout of another project, which does not track it
    if not _git(package, "ls-files", "--error-unmatch", "__init__.py"):
        return ""
    return _git(package, "describe", "--always", "--dirty", "--exclude=*")


def _git(folder: Path, *words: str) -> str:
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=GIT_S, check=False
        )
    except (
        OSError,
        subprocess.TimeoutExpired,
    ):  # without git the report has no commit
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
