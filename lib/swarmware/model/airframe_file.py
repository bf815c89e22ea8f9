"""Files of airframes: share/swarm/airframes/<name>.toml."""

from pathlib import Path

from swarmware.errors import ConfigError
from swarmware.model import document, paths
from swarmware.model.airframe import TYPES, Airframe
from swarmware.model.config import convert


def load_airframe(share_dir: Path, name: str) -> Airframe:
    """The airframe of a file of share/swarm/airframes.

    Raises: ConfigError with file, key and the expected value; for an unknown name with the known ones.
    """
    path = paths.airframe(share_dir, name)
    try:
        text = document.read(path)
    except FileNotFoundError:
        known = ", ".join(sorted(file.stem for file in path.parent.glob("*.toml"))) or "none is installed"
        raise ConfigError(f"{path}: no airframe {name!r}; expected one of {known}") from None
    raw = document.toml(text, str(path))
    kind = raw.get("type")
    if not isinstance(kind, str) or kind not in TYPES:
        given = "missing" if kind is None else repr(kind)
        raise ConfigError(f"key type: {given}; expected one of {', '.join(TYPES)}", source=str(path))
    return convert(raw, TYPES[kind], str(path), text)
