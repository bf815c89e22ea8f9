"""Recognises files of other tools by their first bytes, so that a refusal names them."""

import re
from typing import Final

HEAD_BYTES: Final = 4096
"""Bytes of a file by which its format is recognised."""
_WAYPOINTS: Final = b"QGC WPL"
_FRAMES: Final = {
    b"0": "above mean sea level",
    b"3": "above the start",
    b"5": "above mean sea level",
    b"6": "above the start",
    b"10": "above the terrain",
    b"11": "above the terrain",
}
"""Reference of heights by the number of the frame. Source: MAVLink, enumeration MAV_FRAME."""
_MAGIC: Final = (
    (_WAYPOINTS, "waypoints of QGroundControl or ArduPilot (QGC WPL)"),
    (b"ULog\x01\x12\x35", "a flight log of PX4 (ULog)"),
    (b"\xa3\x95\x80\x80", "a flight log of ArduPilot (DataFlash)"),
    (b"#ROSBAG V", "a bag of ROS 1 (rosbag)"),
    (b"SQLite format 3\0", "a database of SQLite, such as a bag of ROS 2 (rosbag2 .db3)"),
    (b"\x89MCAP0\r\n", "a log of MCAP"),
    (b"PK\x03\x04", "a ZIP archive, such as KMZ"),
    (b"\x1f\x8b", "a file compressed by gzip"),
    (b"\x28\xb5\x2f\xfd", "a file compressed by Zstandard"),
    (b"PAR1", "a table of Parquet"),
)
_XML: Final = rb"(?s)^\s*(?:<\?xml[^>]*\?>)?\s*(?:<!--.*?-->\s*)*"
_PATTERNS: Final = (
    (re.compile(_XML + rb"<kml[\s>]"), "places of Google Earth (KML)"),
    (re.compile(_XML + rb"<gpx[\s>]"), "a track of a receiver (GPX)"),
    (
        re.compile(rb'^\s*\{[^\0]*"fileType"\s*:\s*"(?:Plan|GeoFence|RallyPoints)"'),
        "a plan of QGroundControl (.plan)",
    ),
    (re.compile(rb"^rosbag2_bagfile_information:"), "the description of a bag of ROS 2 (rosbag2)"),
)


def foreign_format(head: bytes) -> str:
    """Name of the format of another tool in which a file begins so, or "" if none is recognised."""
    for magic, name in _MAGIC:
        if head.startswith(magic):
            return name + _frames(head) if magic == _WAYPOINTS else name
    begin = head[:HEAD_BYTES]
    return next((name for pattern, name in _PATTERNS if pattern.search(begin)), "")


def _frames(head: bytes) -> str:
    """Frames of the heights in a file of waypoints, which an operator has to know before converting it."""
    rows = [line.split() for line in head[:HEAD_BYTES].splitlines()[1:]]
    frames = dict.fromkeys(row[2] for row in rows if len(row) > 3 and row[2].isdigit())
    named = [f"{frame.decode()} ({_FRAMES.get(frame, 'unknown here')})" for frame in frames]
    return f", frame {', '.join(named)}" if named else ""
