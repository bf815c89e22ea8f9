"""Options of commands that change who belongs to the swarm."""

from pathlib import Path
from typing import Final

import click

root_option: Final = click.option(
    "--root",
    "root_dir",
    type=click.Path(file_okay=False, path_type=Path),
    envvar="SWARMCTL_ROOT",
    metavar="DIR",
    help="Folder of the swarm's root key; by default ~/.local/share/swarmware/root.",
)

hosts_option: Final = click.option(
    "--hosts",
    "hosts_file",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="HOSTS.toml",
    help="File of `swarmctl fleet` to change as well.",
)
