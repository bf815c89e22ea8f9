"""The span of a mission's run, from the folders of runs of the nodes on this computer."""

from pathlib import Path
from typing import Final

from swarmctl.commandline.settings import CliSettings
from swarmctl.session import labs
from swarmctl.session.session import config_dir
from swarmware.errors import NotFound
from swarmware.mission.run_archive import stored_runs
from swarmware.model import paths
from swarmware.model.config import load_node
from swarmware.types.mission_run import LogCut

RECORDED_NS: Final = 2_000_000_000
"""An entry is recorded up to this time after its instant: `flush_s` of the logger, and a busy computer."""


def run_span(settings: CliSettings, run_id: int) -> tuple[int, int | None]:
    """Begin of a run and its end on the wall clock, or None while a node plays it.

    With several nodes: from the first begin to the last end.
    Raises: NotFound when no selected node has recorded the run.
    """
    cuts = [cut for missions in _missions(settings) for cut in _cuts(missions, run_id)]
    if not cuts:
        raise NotFound(
            f"run {run_id}: not recorded by the nodes on this computer; expected an ID from"
            " `swarmctl mission history`, or --since and --until"
        )
    begin_ns = min(cut.first_utc_ns for cut in cuts)
    if any(not cut.last_utc_ns for cut in cuts):
        return begin_ns, None
    return begin_ns, max(cut.last_utc_ns for cut in cuts) + RECORDED_NS


def _cuts(missions: Path, run_id: int) -> list[LogCut]:
    return [one.record.log for one in stored_runs(missions) if one.record.epoch == run_id]


def _missions(settings: CliSettings) -> list[Path]:
    """Folders with runs: of the selected nodes of a lab, or of this computer's node."""
    lab = labs.chosen(settings)
    if lab is not None:
        return [paths.missions(node.data_dir) for node in lab.select(settings.node)]
    return [paths.missions(load_node(config_dir(settings)).data_path)]
