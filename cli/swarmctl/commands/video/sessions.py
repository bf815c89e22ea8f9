"""Video sessions of a platform: requests to its video daemon, and what it answers."""

import asyncio
from pathlib import Path
from typing import Final

from swarmctl.session.session import Session
from swarmctl.terminal.quantities import bit_s
from swarmctl.terminal.table import Column
from swarmware.errors import InvalidInput, OutOfRange
from swarmware.types.rpc import Empty
from swarmware.types.video import (
    BITRATES_BIT_S,
    VideoDirection,
    VideoRate,
    VideoSession,
    VideoSessions,
    VideoStart,
    VideoStop,
)

_TIMEOUT_S: Final = 10.0
"""The file or camera is opened, and the receiver asked."""
_COLUMNS: Final = (
    Column("SESSION"),
    Column("SOURCE"),
    Column("WAY"),
    Column("TARGET kbit/s", right=True),
    Column("LIMIT kbit/s", right=True),
    Column("PICTURES", right=True),
    Column("SKIPPED", right=True, drop=3),
    Column("PACKETS", right=True),
    Column("LOST", right=True),
    Column("QUEUE ms", right=True),
    Column("LAST CHANGE", drop=2),
)


def bitrate_bit_s(text: str) -> int:
    """Parse the rate of a session: 1mbit, 500kbit. Raises: InvalidInput, OutOfRange."""
    found_bit_s = bit_s(text)
    lowest, highest = BITRATES_BIT_S
    if not lowest <= found_bit_s <= highest:
        raise OutOfRange(f"rate {text}: expected {lowest / 1e3:g}kbit to {highest / 1e9:g}gbit")
    return found_bit_s


async def start(
    session: Session, source: str, to: str, max_bit_s: int, pinned: bool, description: Path | None
) -> None:
    """Starts a session; `description`: file for its SDP. Raises: as `Session.ask`, InvalidInput."""
    is_platform = ":" not in to
    if description is not None and is_platform:
        raise InvalidInput(f"--sdp {description}: {to} is a platform; expected --to HOST:PORT")
    if is_platform:
        await session.reach(to)
    request = VideoStart(source, to, max_bit_s, pinned)
    found = await session.ask("sys/video/start", request, VideoSession, timeout_s=_TIMEOUT_S)
    if description is not None:
        try:
            await asyncio.to_thread(description.write_text, found.sdp)
        except OSError as error:
            session.out.warn(f"{description}: {error.strerror}; the session runs")
    if session.settings.structured:
        session.out.document(found)
        return
    session.out.text(f"session {found.session}: {source} of {session.platform} to {found.other}")
    for line in receivers(found, description):
        session.out.text(line)


def receivers(found: VideoSession, description: Path | None) -> list[str]:
    """How the receiver of a session shows it."""
    if found.path:
        return [f"images: /{found.other}/{found.path}"]
    port = found.other.rpartition(":")[2]
    caps = "application/x-rtp,media=video,clock-rate=90000,encoding-name=H264,payload=96"
    file = description or "FILE"
    shown = [
        f"ffplay -protocol_whitelist file,udp,rtp -fflags nobuffer -flags low_delay -i {file}",
        f'gst-launch-1.0 udpsrc port={port} caps="{caps}" ! rtpjitterbuffer ! rtph264depay ! avdec_h264'
        " ! autovideosink",
    ]
    return shown if description is not None else [*shown, "FILE, the session description:", found.sdp]


async def list_sessions(session: Session) -> None:
    """Prints the sessions of the platform."""
    _show(session, await session.ask("sys/video/ls", Empty(), VideoSessions))


def _show(session: Session, found: VideoSessions) -> None:
    if session.settings.structured:
        session.out.document(found)
        return
    session.out.table(_COLUMNS, [_row(one) for one in found.sessions], empty=f"{session.platform}: no video")
    if found.refused:
        session.out.text(f"refused: {found.refused} packets of no session")


def _row(one: VideoSession) -> tuple[str | int, ...]:
    is_sent = one.direction == VideoDirection.SENT
    last = one.changes[-1].reason if one.changes else ""
    return (
        str(one.session),
        one.source,
        f"to {one.other}" if is_sent else f"from {one.other}",
        round(one.bit_s / 1000) if is_sent else "",
        ("pinned" if one.pinned else round(one.max_bit_s / 1000)) if is_sent else "",
        one.pictures,
        one.skipped + one.dropped,
        one.packets,
        one.lost,
        f"{(one.queueing_s + one.waiting_s) * 1e3:.0f}" if is_sent else "",
        last,
    )


async def set_rate(session: Session, number: int, max_bit_s: int, pinned: bool) -> None:
    """Sets the rate of a session and prints it."""
    found = await session.ask("sys/video/rate", VideoRate(number, max_bit_s, pinned), VideoSession)
    if session.settings.structured:
        session.out.document(found)
        return
    how = "pinned to" if found.pinned else "at most"
    session.out.text(f"session {number}: {how} {found.max_bit_s / 1000:g} kbit/s, now {found.bit_s / 1000:g}")


async def stop(session: Session, number: int) -> None:
    """Ends a session and prints its last counters."""
    _show(session, await session.ask("sys/video/stop", VideoStop(number), VideoSessions))
