"""Video sessions of a platform: requests to its video daemon, and what it answers."""

import asyncio
from pathlib import Path
from typing import Final

from swarmctl.session.session import Session
from swarmctl.terminal.quantities import bit_s
from swarmctl.terminal.table import Cell, Detail, rows_of
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
    # a standard receiver is not a node, so no route shows whether it is reachable
    if is_platform:
        await session.reach(to)
    request = VideoStart(source, to, max_bit_s, pinned)
    found = await session.ask("sys/video/start", request, VideoSession, timeout_s=_TIMEOUT_S)
    if description is not None:
        try:
            await asyncio.to_thread(description.write_text, found.sdp)
        except OSError as error:
            # not an error: the camera is sent, and the description is in `video ls`
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
    session.out.table(_DETAILS, rows_of(_DETAILS, found.sessions), empty=f"{session.platform}: no video")
    if found.refused:
        session.out.text(f"refused: {found.refused} packets of no session")


def _sent(one: VideoSession, cell: Cell) -> Cell:
    """The cell of a session that this platform sends, or an empty one for a received session."""
    return cell if one.direction == VideoDirection.SENT else ""


_DETAILS: Final[list[Detail[VideoSession]]] = [
    Detail("SESSION", value=lambda one: str(one.session)),
    Detail("SOURCE", value=lambda one: one.source),
    Detail("WAY", value=lambda one: _sent(one, f"to {one.other}") or f"from {one.other}"),
    Detail("TARGET kbit/s", value=lambda one: _sent(one, round(one.bit_s / 1000)), right=True),
    Detail(
        "LIMIT kbit/s",
        value=lambda one: _sent(one, "pinned" if one.pinned else round(one.max_bit_s / 1000)),
        right=True,
    ),
    Detail("PICTURES", value=lambda one: one.pictures, right=True),
    Detail("SKIPPED", value=lambda one: one.skipped + one.dropped, right=True, drop=3),
    Detail("PACKETS", value=lambda one: one.packets, right=True),
    Detail("LOST", value=lambda one: one.lost, right=True),
    Detail(
        "QUEUE ms", value=lambda one: _sent(one, f"{(one.queueing_s + one.waiting_s) * 1e3:.0f}"), right=True
    ),
    Detail("LAST CHANGE", value=lambda one: one.changes[-1].reason if one.changes else "", drop=2),
]


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
