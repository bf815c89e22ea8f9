"""Resource paths, sockets, keys and files that are derived from a name are composed in one place."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.architecture.sources import parsed, walked

ROOT: Final = Path(__file__).parents[2]
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
    for folder in ("lib", "daemons", "cli"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = str(path.relative_to(ROOT))
            tree = parsed(path)
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
