"""`mission watch` prints a line for each change of state or block, and none for progress within a block."""

import io

import msgspec
import pytest
from tests.unit.cli.session import ScriptedSession, receipt

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.mission import members
from swarmctl.commands.mission.member_lines import MemberProgress, change_line, display_key, member_table
from swarmctl.commands.mission.members import _raise_unsuccessful
from swarmctl.commands.mission.start import start
from swarmctl.commands.mission.status import print_status
from swarmctl.terminal.output import Output
from swarmware.errors import NotFound, Partial, SwarmError
from swarmware.types.mission import (
    ASKS,
    MissionPhase,
    MissionPlan,
    MissionState,
    MissionStatus,
    MissionTask,
    TaskAnswer,
)
from swarmware.types.reaction import ReactionPhase, ReactionState


def state(
    phase: MissionPhase = MissionPhase.RUNNING, block: str = "goto", text: str = "", ratio: float = 0.5
) -> MissionState:
    return MissionState(1, "ab", phase, (block,) if block else (), (), (), ratio, text, "formation")


def test_block_keeps_one_line_until_it_changes() -> None:
    assert display_key(state(text="12 m left")) == display_key(state(text="11 m left", ratio=0.6))
    assert display_key(state()) != display_key(state(block="land"))
    assert display_key(state()) != display_key(state(MissionPhase.ENDING))
    failed = state(MissionPhase.FAILED, "", "came to failed: goto ended with timeout")
    assert change_line("14:03:22", "uav1", failed) == (
        "14:03:22 uav1     formation    failed                              "
        "came to failed: goto ended with timeout"
    )


def test_question_to_operator_is_shown_while_block_asks() -> None:
    asks = state(text=f"b1: {ASKS}Ready? (mission answer uav1)")
    assert display_key(asks) != display_key(state())
    assert change_line("14:03:22", "uav1", asks).endswith("Ready? (mission answer uav1)")
    assert "asks the operator: Ready?" in member_table("launch", 1.0, {"uav1": MemberProgress(asks, 1.0)})


def test_member_line_has_height_distance_and_arrival() -> None:
    moving = MemberProgress(state(), 3.0, 8.04, 12.0, 2.0)
    lines = member_table(
        "formation",
        61.0,
        {
            "uav1": moving,
            "uav2": MemberProgress(None, 4.0),
            "ugv1": MemberProgress(state(MissionPhase.DONE, "", "done", 1.0), 9.0, 0.0, 0.3, 2.0),
        },
    ).splitlines()
    assert lines[0] == "formation 1m01s"
    assert lines[2].split() == ["uav1", "running", "goto", "50%", "8.0", "12.0", "6.0s", "3.0s"]
    assert lines[3].split() == ["uav2", "no", "state", "yet", "-", "-", "-", "-", "-", "4.0s"]
    assert lines[4].split() == ["ugv1", "done", "done", "100%", "0.0", "-", "-", "9.0s"]


def test_vehicle_at_rest_has_no_arrival_time() -> None:
    assert MemberProgress(state(), 1.0, 2.0, 5.0, 0.1).eta_s is None
    assert MemberProgress(state(), 1.0).eta_s is None


def test_lines_are_redrawn_and_warning_stays_above(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "10")
    out, err = io.StringIO(), io.StringIO()
    terminal = Output(CliSettings(), out, err)
    terminal.redraw("a\nb")
    terminal.redraw("c\n0123456789abc")
    assert out.getvalue() == "a\nb\n\x1b[2F\x1b[Jc\n0123456789\n"
    terminal.warn("x")
    terminal.redraw("d")
    assert out.getvalue().endswith("0123456789\nd\n")


def test_surplus_lines_are_counted_and_finally_shown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("LINES", "5")
    out = io.StringIO()
    terminal = Output(CliSettings(), out)
    text = "\n".join(f"uav{number}" for number in range(1, 7))
    terminal.redraw(text)
    assert out.getvalue().splitlines() == ["uav1", "uav2", "uav3", "… and 3 more lines"]
    terminal.redraw("uav1")
    terminal.redraw(text, last=True)
    assert out.getvalue().endswith("\x1b[4F\x1b[Juav1\n\x1b[1F\x1b[J" + text + "\n")
    terminal.redraw("next")
    assert out.getvalue().endswith("uav6\nnext\n")


def test_end_of_mission_names_reason_of_each_member() -> None:
    shown = {
        "uav1": state(MissionPhase.IDLE, "", "formation was not started: not accepted by uav2"),
        "uav2": state(MissionPhase.FAILED, "", "came to failed: goto ended with timeout"),
        "ugv1": state(MissionPhase.DONE, ""),
    }
    with pytest.raises(SwarmError) as error:
        _raise_unsuccessful(shown, set(shown), set())
    assert str(error.value) == (
        "mission formation: unsuccessful at "
        "uav1 (not started: formation was not started: not accepted by uav2), "
        "uav2 (failed: came to failed: goto ended with timeout)"
    )


async def test_refused_start_names_reason_in_its_error() -> None:
    refusal = msgspec.structs.replace(receipt("uav2", accepted=False), reasons=("uav2 is busy",))
    answers = {
        "sys/mission/plan": MissionPlan("formation", "h", ()),
        "sys/mission/task": TaskAnswer("formation", "h", 1, False, (refusal,)),
    }
    session = ScriptedSession(answers)
    with pytest.raises(Partial, match=r"refused or not answered by uav2 \(uav2 is busy\); not started"):
        await start(session, "formation", MissionTask("formation"), (), yes=True, watch=True)


@pytest.mark.parametrize("node", ["", "uav1"])
async def test_mission_watch_before_first_has_none(node: str, monkeypatch: pytest.MonkeyPatch) -> None:
    idle = MissionState(0, "", MissionPhase.IDLE)
    monkeypatch.setattr(members, "mission_states", lambda session: {"uav1": idle})
    session = ScriptedSession({"sys/mission/status": MissionStatus("uav1", idle, "", 0)}, node=node)
    with pytest.raises(NotFound, match="no mission was started; expected one"):
        await members.watch(session, ())


async def test_the_status_names_who_ordered_the_mission() -> None:
    found = MissionStatus("uav1", state(), "leader", 0, ordered_by="ann@gcs")
    session = ScriptedSession({"sys/mission/status": found}, node="uav1")
    await print_status(session)
    assert "uav1: ordered by ann@gcs" in session.stderr.getvalue()
    assert "formation" in session.stdout.getvalue()


async def test_status_shows_active_reactions_and_dead_rows() -> None:
    rows = (
        ReactionState("battery_low", ReactionPhase.ACTIVE, "return", 0, "battery low"),
        ReactionState("position_lost", ReactionPhase.IDLE, "land", 0),
        ReactionState("motor_hot", ReactionPhase.IDLE, "land", 0, note="no field 'temp'"),
    )
    found = MissionStatus("uav1", state(), "leader", 0, reactions=rows)
    session = ScriptedSession({"sys/mission/status": found}, node="uav1")
    await print_status(session)
    shown = [line.split() for line in session.stdout.getvalue().splitlines()]
    assert shown[-3:] == [
        ["REACTION", "PHASE", "ACTION", "REASON"],
        ["battery_low", "active", "return", "battery", "low"],
        ["motor_hot", "idle", "land", "no", "field", "'temp'"],
    ]


async def test_who_watches_a_mission_sees_who_ordered_it(monkeypatch: pytest.MonkeyPatch) -> None:
    async def follow(*_: object) -> None:
        """Stands for a mission that has ended."""

    playing = msgspec.structs.replace(state(), epoch=7)
    monkeypatch.setattr(members, "mission_states", lambda session: {"uav1": playing})
    monkeypatch.setattr(members, "follow", follow)
    found = MissionStatus("uav1", playing, "leader", 0, ordered_by="ann@gcs")
    session = ScriptedSession({"sys/mission/status": found}, node="uav1")
    await members.watch(session, ())
    assert session.stderr.getvalue() == "formation: ordered by ann@gcs\n"
