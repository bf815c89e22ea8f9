"""The check in a separate process: a request on stdin, findings on stdout, both as MessagePack."""

import contextlib
import os
import resource
import sys
from typing import Final

import msgspec

from swarmware.mission.binding import Binding
from swarmware.mission.budget import Budget
from swarmware.mission.check import check_folder, check_text
from swarmware.mission.finding import Finding, too_large
from swarmware.mission.folder import Folder
from swarmware.mission.installed import installed

MEMORY_BYTES: Final = 512 << 20
"""Limit of the address space, eight times the check's own budget: it bounds memory that is not counted
there."""
CPU_S: Final = 20
"""Processor time; the largest mission that fits the budget takes about two seconds."""


class FolderJob(msgspec.Struct, frozen=True, tag=True):
    """The mission of a whole ensemble, to be checked."""

    folder: Folder


class TextJob(msgspec.Struct, frozen=True, tag=True):
    """The mission of one member, to be checked."""

    text: str
    file: str
    binding: Binding


Job = FolderJob | TextJob


def judge(job: Job) -> list[Finding]:
    """The findings of one check."""
    try:
        catalogue = installed()
        if isinstance(job, FolderJob):
            return check_folder(job.folder, catalogue, Budget())
        return check_text(job.text, job.file, job.binding, catalogue, Budget())[1]
    except MemoryError:
        return [too_large(job.folder.where if isinstance(job, FolderJob) else job.file)]


def main() -> None:
    """Read one job from stdin, check it, write its findings to stdout."""
    # a second limit besides the check's budget; a hardened unit forbids it (EPERM) and has its own limits
    with contextlib.suppress(OSError):
        os.nice(10)  # a check must not slow down a mission that is flying
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
    # output of the packages of plug-in blocks goes to stderr
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    job = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Job)
    with answer:
        answer.write(msgspec.msgpack.encode(judge(job)))


if __name__ == "__main__":
    main()
