"""Checks missions without blocking the event loop: small ones at once, others in a separate process."""

import asyncio
import logging
import sys
from collections import OrderedDict
from typing import Final, TypeVar

import msgspec

from swarmd.mission.worker import FolderJob, Job, TextJob
from swarmware.errors import MissionError
from swarmware.mission.assignment import Assignment
from swarmware.mission.binding import Binding
from swarmware.mission.budget import QUICK_BYTES, Budget
from swarmware.mission.catalogue import Catalogue
from swarmware.mission.check import check_folder, check_text
from swarmware.mission.finding import TOO_LARGE, Finding, sound
from swarmware.mission.folder import Folder
from swarmware.mission.loader import read
from swarmware.mission.model import MissionDefinition, content_hash

log = logging.getLogger("swarm.mission")

QUICK_TEXT: Final = 32_768
"""Maximum characters of a mission checked in the event loop, about 10 ms; the shipped ones have 6 000."""
TIME_S: Final = 30.0
"""Time-out of a check in a separate process, including the start of Python on a busy computer."""
UNFINISHED: Final = "unfinished"
"""Rule of the finding that a check did not end; the next request checks again."""
REMEMBERED: Final = 64
"""Maximum number of cached results: more missions than a store has."""

Findings = tuple[Finding, ...]
Kept = TypeVar("Kept")


class Checker:
    """Checks missions and caches the results by content."""

    def __init__(self, catalogue: Catalogue) -> None:
        self.catalogue = catalogue
        self._verdicts: OrderedDict[str, Findings] = OrderedDict()
        self._missions: OrderedDict[str, MissionDefinition] = OrderedDict()
        self._warnings: OrderedDict[str, Findings] = OrderedDict()
        # one process at a time: many requested checks wait and do not load the computer
        self._turn = asyncio.Lock()

    async def check(self, folder: Folder) -> Findings:
        """The findings of the check of an ensemble's mission."""
        # findings name files, so they are cached by folder; a result without findings, by content
        for known in (folder.hash, content_hash(folder.where, folder.hash)):
            if known in self._verdicts:
                return self._verdicts[known]
        large = sum(map(len, folder.texts.values())) > QUICK_TEXT
        found = None if large else check_folder(folder, self.catalogue, Budget(QUICK_BYTES))
        verdict = await self._finished(found, FolderJob(folder), folder.where)
        if any(finding.rule == UNFINISHED for finding in verdict):
            return verdict  # a busy computer says nothing about the mission
        key = content_hash(folder.where, folder.hash) if verdict else folder.hash
        return _keep(self._verdicts, key, verdict)

    def known(self, text: str, file: str, binding: Binding) -> MissionDefinition | None:
        """The mission of one member if it was read before, and is still cached."""
        found = self._missions.get(_key(text, binding))
        return found if found is None or found.file == file else msgspec.structs.replace(found, file=file)

    async def load(self, text: str, file: str, binding: Binding) -> MissionDefinition:
        """Reads and checks the mission of one member.

        Raises: MissionError with all reasons, one a line.
        """
        known = self.known(text, file, binding)
        if known is not None:
            return known
        quick: list[Finding] | None = None
        if len(text) <= QUICK_TEXT:
            reading, quick = check_text(text, file, binding, self.catalogue, Budget(QUICK_BYTES))
        verdict = await self._finished(quick, TextJob(text, file, binding), file)
        refuse(verdict)
        if quick is None:
            reading = await asyncio.to_thread(read, text, file, binding, self.catalogue)
        if reading.mission is None:
            raise MissionError("\n".join(str(finding) for finding in reading.findings))
        _keep(self._warnings, _key(text, binding), verdict)
        return _keep(self._missions, _key(text, binding), reading.mission)

    def warnings(self, text: str, binding: Binding) -> Findings:
        """The findings about the mission of one member that was read and accepted."""
        return self._warnings.get(_key(text, binding), ())

    async def check_params(self, folder: Folder, assignment: Assignment) -> None:
        """Checks the text of each role with the parameters of its first member, before an order is sent.

        Raises: MissionError with all reasons, one a line.
        """
        first = {one.member.role: one for one in reversed(assignment.member_assignments)}
        for one in first.values():
            await self.load(folder.texts[one.file], folder.place(one.file), one.binding)

    async def _finished(self, quick: list[Finding] | None, job: Job, where: str) -> Findings:
        """The findings of the quick check, or of a separate process if the quick check was skipped or
        exceeded its budget."""
        if quick is not None and not any(finding.rule == TOO_LARGE for finding in quick):
            return tuple(quick)
        async with self._turn:
            return tuple(await _apart(job, where))


def _key(text: str, binding: Binding) -> str:
    return content_hash("text", text, msgspec.json.encode(binding).decode())


def refuse(findings: Findings) -> None:
    """Raises: MissionError when a mission with these findings must not be flown."""
    if not sound(findings):
        raise MissionError("\n".join(str(f) for f in findings if f.severity != "warning"))


async def _apart(job: Job, where: str) -> list[Finding]:
    """The findings of a check in a separate process, which is killed at its time-out."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-P",
        "-m",
        "swarmd.mission.worker",
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(TIME_S):
            answer, complaints = await process.communicate(msgspec.msgpack.encode(job))
        return msgspec.msgpack.decode(answer, type=list[Finding])
    except TimeoutError:
        return [_unfinished(where)]
    except msgspec.DecodeError:
        words = complaints.decode(errors="replace").strip().splitlines()
        log.warning("check of %s: ended with %s: %s", where, process.returncode, words[-1:] or "")
        return [_unfinished(where)]
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


def _unfinished(where: str) -> Finding:
    """The finding of a check that was ended from outside: by its time-out, or by the system."""
    message = (
        f"not checked: the check did not end within {TIME_S:g} s, or was killed; expected a less busy "
        "computer, try again"
    )
    return Finding(where, 0, "", "unknown", UNFINISHED, message)


def _keep(memory: OrderedDict[str, Kept], key: str, value: Kept) -> Kept:
    memory[key] = value
    while len(memory) > REMEMBERED:
        memory.popitem(last=False)
    return value
