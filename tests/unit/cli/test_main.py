"""`swarmctl` itself: lazy commands, shared options, errors and exit codes."""

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import click
import pytest

from swarmctl import main as swarmctl
from swarmctl.commandline.lazy import Command
from swarmctl.commandline.settings import CliSettings
from swarmware import errors
from swarmware.runtime.filewriter import naming


def test_shared_options_stand_before_or_after_the_command(probe: ModuleType) -> None:
    assert swarmctl.main(["--json", "-n", "uav1", "probe", "show", "--timeout", "2", "--rate", "3"]) == 0
    assert probe.seen == CliSettings(node="uav1", output="json", timeout_s=2.0)
    assert probe.rate == 3.0
    assert swarmctl.main(["-n", "uav1", "probe", "show", "-n", "uav2", "-q"]) == 0
    assert probe.seen == CliSettings(node="uav2", quiet=True)


def test_every_option_is_also_read_from_the_environment(
    probe: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWARMCTL_NODE", "uav7")
    monkeypatch.setenv("SWARMCTL_TIMEOUT", "9")
    monkeypatch.setenv("SWARMCTL_JSON", "1")
    monkeypatch.setenv("SWARMCTL_PROBE_SHOW_RATE", "5")
    assert swarmctl.main(["probe", "show"]) == 0
    assert probe.seen == CliSettings(node="uav7", timeout_s=9.0, output="json")
    assert probe.rate == 5.0
    assert swarmctl.main(["probe", "show", "-n", "uav1"]) == 0
    assert probe.seen.node == "uav1", "the command line goes before the environment"


def test_command_that_uses_letter_itself_keeps_it() -> None:
    own = Command("x", params=[click.Option(["-n", "--number"])])
    spellings = [name for param in own.params for name in param.opts]
    assert spellings.count("-n") == 1
    assert "--json" in spellings


@pytest.mark.parametrize(("kind", "cls"), errors.KINDS.items())
def test_each_error_is_one_line_and_code(
    probe: ModuleType, capsys: pytest.CaptureFixture[str], kind: str, cls: type[errors.SwarmError]
) -> None:
    assert swarmctl.main(["probe", "fail", kind]) == cls.exit_code
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("", "error: nav/pose (uav3): gone; expected alive\n")


def test_our_error_is_found_inside_groups_of_tasks(
    probe: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert swarmctl.main(["probe", "fail", "group"]) == 6
    assert capsys.readouterr().err == "error: inner\n"


def test_a_bug_of_ours_is_named_and_fails(probe: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl.main(["probe", "fail", "bug"]) == 1
    assert "ZeroDivisionError: oh" in capsys.readouterr().err


def test_interruption_usage_and_partial_results_have_codes(probe: ModuleType) -> None:
    assert swarmctl.main(["probe", "fail", "interrupt"]) == 130
    assert swarmctl.main(["probe", "fail", "abort"]) == 130
    assert swarmctl.main(["probe", "show", "--rate", "fast"]) == 2
    assert swarmctl.main(["probe", "show", "--timeout", "0"]) == 2
    assert swarmctl.main(["probe", "partly"]) == 3


def test_an_unknown_command_is_answered_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl.main(["missin"]) == 2
    assert "did you mean 'mission'?" in capsys.readouterr().err


def test_help_lists_commands_in_titled_sections(capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl.main(["--help"]) == 0
    shown = capsys.readouterr().out
    columns = set()
    for title, section in swarmctl.SECTIONS.items():
        lines = shown.partition(f"\n{title}:\n")[2].partition("\n\n")[0].splitlines()
        assert [line.split()[0] for line in lines] == list(section), title
        for line, lazy in zip(lines, section.values(), strict=True):
            assert line.endswith(lazy.summary)
            columns.add(line.index(lazy.summary))
    assert len(columns) == 1, "the summaries of all sections begin in one column"


def test_every_command_has_one_section() -> None:
    listed = [name for section in swarmctl.SECTIONS.values() for name in section]
    assert sorted(listed) == sorted(set(listed))
    assert set(swarmctl.cli.list_commands(click.Context(swarmctl.cli))) == set(listed)


@pytest.mark.parametrize("group", ["tree", "fleet", "keys", "log", "lab"])
def test_list_of_subcommands_has_their_whole_first_sentences(
    group: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert swarmctl.main([group, "--help"]) == 0
    listed = capsys.readouterr().out.partition("Commands:")[2]
    assert "..." not in listed
    assert listed.count("\n  ") >= 4


def test_summary_is_first_sentence_of_help() -> None:
    from swarmlab.command import cmd

    assert cmd.get_short_help_str(limit=200) == swarmctl.SECTIONS["Develop"]["lab"].summary


def test_completions_come_from_the_table_and_import_nothing() -> None:
    env = {
        **os.environ,
        "_SWARMCTL_COMPLETE": "bash_complete",
        "COMP_WORDS": "swarmctl mi",
        "COMP_CWORD": "1",
    }
    run = [sys.executable, "-m", "swarmctl"]
    done = subprocess.run(run, env=env, capture_output=True, text=True, check=True)
    assert done.stdout == "plain,mission\n"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_are_printed(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl.main(["completion", shell]) == 0
    assert "_SWARMCTL_COMPLETE" in capsys.readouterr().out


def test_a_program_on_the_path_is_a_command(tmp_path: Path) -> None:
    program = tmp_path / "swarmctl-hey"
    program.write_text('#!/bin/sh\necho "hey $*"\nexit 9\n')
    program.chmod(0o755)
    env = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    run = [sys.executable, "-m", "swarmctl"]
    done = subprocess.run(
        [*run, "hey", "--loud", "-x", "1"], env=env, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (9, "hey --loud -x 1\n")
    listed = subprocess.run([*run, "--help"], env=env, capture_output=True, text=True, check=True).stdout
    assert "swarmctl-hey" in listed


@pytest.mark.parametrize("command", ["completion bash", "--help", "mission check formation", "lab ls"])
def test_a_closed_stdout_is_no_error(command: str) -> None:
    script = f"{sys.executable} -m swarmctl {command} >&-"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("completion bash", "error: stdout: no space left on device\n"),
        (
            "mission check formation --json",
            '{"schema_version":2,"error":"stdout: no space left on device","exit_code":1}\n',
        ),
    ],
)
def test_a_full_device_behind_stdout_is_named(command: str, answer: str) -> None:
    script = f"{sys.executable} -m swarmctl {command} >/dev/full"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, answer)


def test_a_file_on_a_full_device_is_named(
    probe: ModuleType, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: CliSettings) -> None:
        with naming("flight.csv"), Path("/dev/full").open("w") as file:
            file.write("x")

    monkeypatch.setattr("swarmctl.main.settings", full)
    assert swarmctl.main(["probe", "show"]) == 1
    assert capsys.readouterr().err == "error: file flight.csv: no space left on device\n"


def test_long_refused_argument_is_shown_by_ends(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert swarmctl.main(["mission", "check", "x" * 120_000]) != 0
    shown = capsys.readouterr().err
    assert "characters …" in shown
    assert len(shown) < 3 * swarmctl.LINE_CHARACTERS


def test_reader_that_has_seen_enough_is_no_error() -> None:
    script = f"{sys.executable} -m swarmctl --help | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "words",
    [
        ["-n", "", "node", "ls"],
        ["node", "ls", "--node", ""],
        ["node", "info", ""],
        ["--lab", "", "node", "ls"],
        ["--config", "", "node", "ls"],
        ["land", "uav1", ""],
        ["kill", ""],
        ["health", "info", ""],
        ["mission", "start", "formation", "--member", ""],
    ],
)
def test_empty_name_is_refused_not_joined_node(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl.main(words) == 2
    assert "empty; expected a name" in capsys.readouterr().err
