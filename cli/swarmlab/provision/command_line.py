"""The command that repeats a run of the lab."""

import shlex
from pathlib import Path

from swarmlab.provision.provisioning import LabSpec
from swarmware.recorder.address import without_password


def run_command(spec: LabSpec, duration_s: float, out_dir: Path) -> str:
    """The command of a run with all options that determine it; a password is masked."""
    words = ["swarmctl", "lab", "run", spec.experiment, "--nodes", str(spec.nodes)]
    if spec.usv:
        words += ["--usv", str(spec.usv)]
    words += ["--net", spec.net, "--seed", str(spec.seed)]
    if spec.radio:
        words += ["--radio", spec.radio]
    if spec.name:
        words += ["--name", spec.name]
    if spec.per_daemon is not None:
        words += ["--per-daemon", spec.per_daemon]
    if spec.units is not None:
        words += ["--units", spec.units]
    for airframe in spec.airframe:
        words += ["--airframe", airframe]
    for service in spec.services:
        words += ["--service", service]
    if spec.mongodb_uri:
        words += ["--mongodb", without_password(spec.mongodb_uri)]
    return shlex.join([*words, "--duration", f"{duration_s:g}", "--out", str(out_dir)])
