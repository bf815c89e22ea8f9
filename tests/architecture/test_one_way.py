"""One way to do each thing: what has a place of its own in the library is not written again elsewhere.

Names that a linter can ban are in pyproject.toml.
"""

import ast
import re
from collections.abc import Iterator
from typing import Final

from tests.architecture.sources import trees, walked

TREES: Final = trees()

REPLACE: Final = re.compile(r"os\.(replace|renames?)|.*\.rename|(path|fresh)\.replace")
"""Calls that replace a file."""
REPLACING: Final = {
    "lib/swarmware/runtime/filewriter.py": "the writer of files",
    "lib/swarmware/transport/shm/ringfile.py": "a ring gets its name when it is filled",
    "lib/swarmware/transport/shm/shared_file.py": "sets a folder aside that is in the way of a file",
    "lib/swarmware/transport/appfile/trace.py": "sets the file of a dead application aside",
    "lib/swarmware/recorder/growing_file.py": "a segment gets its name when it has its end",
    "lib/swarmware/recorder/ring.py": "sets a damaged segment aside",
    "cli/swarmctl/commands/log/tables.py": "a table gets its name at its end",
}
"""Files that replace a file, each with its reason."""


def test_file_is_replaced_in_one_place() -> None:
    found = {
        path
        for path, tree in TREES.items()
        for node in walked(tree)
        if isinstance(node, ast.Call) and REPLACE.fullmatch(ast.unparse(node.func))
    }
    assert found == set(REPLACING), "expected swarmware.runtime.filewriter, or a reason here"


def is_own_backoff(node: ast.AST) -> bool:
    """Whether this is `pauses[min(failures, len(pauses) - 1)]`, or `min(2 * pause, limit)`."""
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Call | ast.BinOp):
        return "min(" in ast.unparse(node.slice) and "len(" in ast.unparse(node.slice)
    if not (isinstance(node, ast.Call) and ast.unparse(node.func) == "min"):
        return False
    return any(
        isinstance(side, ast.BinOp) and isinstance(side.op, ast.Mult | ast.Pow) and number in {"2", "2.0"}
        for side in node.args
        if isinstance(side, ast.BinOp)
        for number in (ast.unparse(side.left), ast.unparse(side.right))
    )


BACKOFF: Final = {
    "lib/swarmware/runtime/backoff.py": "the rule of a back-off",
    "daemons/swarmd/logger/log_forwarder.py": "the size of a batch, which grows with success",
    "lib/swarmware/transport/delivery/outbox.py": "a time-out that begins with the round trip",
}


def test_there_is_one_back_off() -> None:
    found = {path for path, tree in TREES.items() if any(is_own_backoff(node) for node in walked(tree))}
    assert found == set(BACKOFF), "expected swarmware.runtime.backoff.pause_after, or a reason here"


PROC: Final = {
    "lib/swarmware/runtime/pidfd.py": "field 22 of /proc/PID/stat: psutil gives wall clock times",
    "lib/swarmware/service/realtime.py": "the capabilities of this process, which psutil does not have",
    "lib/swarmware/service/fork_client.py": "the own network namespace, which psutil does not have",
    "lib/swarmware/service/status.py": "own memory, once a second, in daemons without psutil",
    "lib/swarmware/transport/shm/owner.py": "the boot id, which psutil does not have",
    "lib/swarmware/testing/leaks.py": "descriptors and children of a thread, not in psutil",
    "daemons/swarmd/hal/drivers/computer.py": "load of the computer, in each node: psutil costs a megabyte",
    "lib/swarmware/runtime/processor.py": "use of all processors, in each node: psutil costs a megabyte",
    "daemons/swarmd/guard/priorities.py": "the own capabilities, which psutil does not have",
    "daemons/swarmd/fork_server.py": "own threads and command line, before anything is imported",
    "daemons/swarmd/broker/sockets/zmq/zmq_socket.py": "the thread ids of libzmq, to set their priority",
    "cli/swarmlab/measure/host.py": "the model of the processor, which psutil does not have",
    "cli/swarmlab/radio/namespace.py": "network namespaces and own capabilities, which psutil does not have",
}
"""Readers of /proc, each with what psutil would cost or lacks."""


def test_proc_is_read_where_psutil_does_not_serve() -> None:
    found = {
        path
        for path, tree in TREES.items()
        for node in walked(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("/proc")
    }
    assert found == set(PROC), "expected psutil, or the reason against it in this list"


HOME: Final = {"lib/swarmware/model/paths.py", "lib/swarmware/model/names.py"}
DERIVED: Final = re.compile(
    r"\.(toml|sock|key|readers)\b|^ipc://|^/(dev|tmp|run|var)/|(^|/)(app|config|health|sim|sys)/"
)
"""Parts of resource paths and of files; a text with a blank is a message."""
EXCEPTIONS: Final = {
    (
        "lib/swarmware/service/starting.py",
        "f'{name}#1.toml'",
    ): "the parent of a node lives without pathlib",
    (
        "cli/swarmctl/commandline/completion.py",
        "f'/tmp/swarm-{os.getuid()}'",
    ): "the one place of the labs' folder: the completion of the shell imports nothing else",
    ("daemons/swarmd/health/core/apps.py", "f'app/{self.name}'"): "the name of a check, no path",
    ("daemons/swarmd/health/core/apps.py", "f\"app/{self.id.replace('#', '_')}\""): "the name of a check",
}
"""Texts that are composed elsewhere, each with its reason."""


def composed() -> Iterator[tuple[str, str, int]]:
    """File, text and line of each composed path."""
    for name, tree in TREES.items():
        for node in walked(tree) if name not in HOME else ():
            if isinstance(node, ast.JoinedStr):
                parts = [str(part.value) for part in node.values if isinstance(part, ast.Constant)]
                if not any(" " in part for part in parts) and any(map(DERIVED.search, parts)):
                    yield name, ast.unparse(node), node.lineno


def test_derived_path_is_composed_in_one_place() -> None:
    found = {(name, text): line for name, text, line in composed()}
    new = [f"{name}:{line} {text}" for (name, text), line in found.items() if (name, text) not in EXCEPTIONS]
    assert not new, "expected a function of swarmware.model.paths, or names.join:\n" + "\n".join(new)
    assert set(EXCEPTIONS) <= set(found), "an exception is no longer needed"
