"""The six ways in which a command is ended from outside, for one command of each kind, as real processes."""

import os
import signal
import subprocess
from pathlib import Path
from typing import Final

import pytest
from tests.integration.cli.conftest import Lab
from tests.patience import PATIENCE_S

KINDS: Final = {
    "result": "tree get /uav1/nav/pose",
    "list": "tree ls",
    "follower": "tree watch /uav1/nav/pose",
    "journal": "log tail '/uav1/**'",
    "bytes": "log export --node uav1 --format mcap --out -",
}
"""A command of each kind; a follower has no end of its own."""
FOLLOWERS: Final = ("follower", "journal")
WAITING: Final = {
    "result": "wait /uav1/nav/pose 'z_m > 90000' --timeout 600",
    "list": "tree watch '/uav1/**' --json",
    **{kind: KINDS[kind] for kind in FOLLOWERS},
}
"""Commands that still run when a signal comes."""
FULL: Final = "no space left on device"


@pytest.mark.parametrize("kind", KINDS)
def test_reader_that_closes_pipe_ends_command_without_error(lab: Lab, kind: str) -> None:
    process = lab.started(KINDS[kind])
    with process:
        assert process.stdout is not None
        assert process.stderr is not None
        os.read(process.stdout.fileno(), 1)
        process.stdout.close()
        said = process.stderr.read()
        assert process.wait(PATIENCE_S) == 0, said
    assert "rror" not in said


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in FOLLOWERS])
def test_a_closed_stdout_is_no_error(lab: Lab, kind: str) -> None:
    done = subprocess.run(
        ["bash", "-c", '"$@" >&-', "bash", *lab.words(KINDS[kind])],
        env=lab.env,
        stdin=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stderr
    assert "rror" not in done.stderr


@pytest.mark.parametrize("kind", KINDS)
def test_full_device_is_error_that_names_stdout(lab: Lab, kind: str) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            lab.words(KINDS[kind]),
            env=lab.env,
            stdin=subprocess.DEVNULL,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )
    assert done.returncode == 1
    assert f"stdout: {FULL}" in done.stderr


@pytest.mark.parametrize(
    "command",
    [
        "tree dump /uav1/nav --file /dev/full",
        "config dump --node uav1 /dev/full",
        "log export --node uav1 --out /dev/full",
        "topo --png /dev/full",
    ],
)
def test_full_device_behind_file_is_named_error(lab: Lab, command: str) -> None:
    done = lab.ctl(command)
    assert done.code == 1
    assert f"/dev/full: {FULL}" in done.err


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
@pytest.mark.parametrize("kind", WAITING)
def test_signal_ends_command_within_second_with_its_code(lab: Lab, kind: str, number: signal.Signals) -> None:
    process = lab.started(WAITING[kind])
    with process:
        if kind != "result":  # it prints nothing before its end; a signal during its start ends it, too
            assert process.stdout is not None
            os.read(process.stdout.fileno(), 1)
        process.send_signal(number)
        # a second is the promise on an idle computer; the tests run beside others
        assert process.wait(PATIENCE_S) in {128 + number, -number}
