"""The record of the role and the race for it, in one process: a lock belongs to an open file."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.node.master.record import NO_HOLDER, Holder, RecordFile
from swarmware.node.master.role import LOCK_NAME, LeaderCandidate
from swarmware.runtime.pidfd import start_ticks


def test_new_record_is_empty_and_keeps_contents(tmp_path: Path) -> None:
    record = RecordFile(tmp_path / LOCK_NAME)
    assert (record.holder(), record.requested_by()) == (NO_HOLDER, (0, 0))
    before = record.mark()
    record.write_holder(Holder(7, 12, 345, "register#1"))
    record.request_leadership(9, 8)
    other = RecordFile(tmp_path / LOCK_NAME)
    assert (other.holder(), other.requested_by()) == (Holder(7, 12, 345, "register#1"), (9, 8))
    assert other.mark() != before
    record.close()
    other.close()


def test_truncated_record_is_empty_and_harmless(tmp_path: Path) -> None:
    record = RecordFile(tmp_path / LOCK_NAME)
    record.write_holder(Holder(7, 12, 345, "register#1"))
    os.truncate(tmp_path / LOCK_NAME, 0)
    assert (record.holder(), record.requested_by()) == (NO_HOLDER, (0, 0))
    record.write_holder(Holder(1, 2, 3, "x"))
    assert record.holder() == Holder(1, 2, 3, "x")
    record.close()


def test_any_bytes_are_a_holder_or_none(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("record") / LOCK_NAME

    @given(st.binary(max_size=300))
    def check(data: bytes) -> None:
        path.write_bytes(data)
        record = RecordFile(path)
        assert record.holder() is None or not any(data[:72]), data
        record.requested_by()
        record.close()

    check()


class Race:
    """Candidates of one node; a bell of one makes all others look."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.roles: dict[str, LeaderCandidate] = {}
        self.log: list[tuple[str, str, int]] = []

    def join(self, name: str) -> LeaderCandidate:
        role = LeaderCandidate(
            self.folder,
            name,
            ring=self.ring,
            on_gained=lambda epoch: self.log.append((name, "gained", epoch)),
            on_lost=lambda: self.log.append((name, "lost", 0)),
        )
        self.roles[name] = role
        role.start()
        return role

    def ring(self) -> None:
        for role in list(self.roles.values()):
            role.poll()

    @property
    def holding(self) -> list[str]:
        return [name for name, role in self.roles.items() if role.holding]

    def close(self) -> None:
        for role in self.roles.values():
            role.close()


async def test_next_holder_takes_over_with_higher_number(
    tmp_path: Path,
) -> None:
    race = Race(tmp_path)
    first = race.join("a")
    race.join("b")
    assert race.holding == ["a"]
    first.close()
    assert race.holding == ["b"]
    assert race.log == [("a", "gained", 1), ("a", "lost", 0), ("b", "gained", 2)]
    assert race.roles["b"].holder.label == "b"
    race.close()


async def test_holder_becoming_preferred_keeps_its_number(tmp_path: Path) -> None:
    race = Race(tmp_path)
    role = race.join("a")
    race.join("b")
    role.volunteer("register#1")
    assert (race.holding, role.holder.label, role.holder.epoch) == (["a"], "register#1", 1)
    role.step_back("a")
    assert (race.holding, role.holder.label) == (["a"], "a")
    race.close()
    assert race.holding == []


def as_another_process(role: LeaderCandidate) -> None:
    """Makes a candidate act for another living process."""
    role._me = (os.getppid(), start_ticks(os.getppid()))


async def test_stand_in_gives_role_up_for_preferred_process(tmp_path: Path) -> None:
    race = Race(tmp_path)
    race.join("stand-in")
    register = race.join("register")
    as_another_process(register)
    register.volunteer("register#1")
    assert race.holding == ["register"]
    assert race.log[1:] == [("stand-in", "lost", 0), ("register", "gained", 2)]
    race.roles["stand-in"].poll()
    assert race.holding == ["register"], "who is preferred keeps it"
    race.close()


async def test_unpreferred_process_waits_for_living_candidate(
    tmp_path: Path,
) -> None:
    race = Race(tmp_path)
    first = race.join("first")
    wanting = RecordFile(tmp_path / LOCK_NAME)
    wanting.request_leadership(os.getppid(), start_ticks(os.getppid()))
    first.close()
    second = race.join("second")
    assert race.holding == [], "it was given back for the one that wants it"
    wanting.request_leadership(os.getppid(), 1)  # another process had this number: that one has died
    second._contend()
    assert race.holding == ["second"]
    wanting.close()
    race.close()
