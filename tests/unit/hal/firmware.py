"""Firmware of a chassis on a pseudo-terminal, written from `chassis-protocol.md` alone."""

import asyncio
import os
import pty
import struct
import tty
from pathlib import Path

REPORT_S = 0.05


def crc16(data: bytes) -> int:
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def encoded(body: bytes) -> bytes:
    data = body + struct.pack("<H", crc16(body)) + b"\0"
    out, at = bytearray(), 0
    while at < len(data):
        end = data.index(0, at)
        out += bytes([end - at + 1]) + data[at:end]
        at = end + 1
    return bytes(out) + b"\0"


def decoded(frame: bytes) -> bytes | None:
    out, at = bytearray(), 0
    while at < len(frame):
        if frame[at] == 0 or at + frame[at] > len(frame):
            return None
        out += frame[at + 1 : at + frame[at]] + b"\0"
        at += frame[at]
    body, crc = bytes(out[:-3]), bytes(out[-3:-1])
    return body if crc == struct.pack("<H", crc16(body)) else None


class Firmware:
    """Follows the protocol at one end of a pseudo-terminal; `path` is the other one."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.armed, self.landed, self.answered, self.reason = False, True, 0, ""
        self.gains: dict[str, float] = {"rate_kp": 0.1}
        self.calibrations = 0
        self.setpoints: list[tuple[float, ...]] = []
        self.deaf = 0
        self.noise = b""
        self._master = -1
        self._slave = -1
        self._received = b""
        self._reports: asyncio.Task[None] | None = None
        self._set_at = 0.0

    def plug(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(self._slave))
        loop = asyncio.get_running_loop()
        loop.add_reader(self._master, self._readable)
        self._reports = loop.create_task(self._report_always())

    def unplug(self) -> None:
        if self._reports is not None:
            self._reports.cancel()
            self._reports = None
            asyncio.get_running_loop().remove_reader(self._master)
            self.link.unlink()
            os.close(self._slave)
            os.close(self._master)

    async def _report_always(self) -> None:
        while True:
            self.report()
            await asyncio.sleep(REPORT_S)

    def report(self) -> None:
        quiet = asyncio.get_running_loop().time() - self._set_at > 0.5
        flags = self.armed | self.landed << 1 | (self.armed and quiet) << 3
        body = struct.pack("<BQBfff", 0x81, self.answered, flags, 24.5, 3.25, 0.75) + self.reason.encode()
        os.write(self._master, self.noise + encoded(body))

    def _readable(self) -> None:
        *frames, self._received = (self._received + os.read(self._master, 4096)).split(b"\0")
        for frame in frames:
            body = decoded(frame)
            if body and body[0] == 1:
                self._set_at = asyncio.get_running_loop().time()
                self.setpoints.append(struct.unpack_from("<ffff", body, 1))
            elif body and body[0] == 2:
                self._order(body)

    def _order(self, body: bytes) -> None:
        number, action = struct.unpack_from("<QB", body, 1)
        if self.deaf:
            self.deaf -= 1
            return
        if number > self.answered:
            self.answered, self.reason = number, ""
            if action == 1:
                self.armed = True
            elif action in {2, 3}:
                self.armed = False
            elif action == 4:
                given = {
                    name.rstrip(b"\0").decode(): value
                    for name, value in struct.iter_unpack("<16sf", body[10:])
                }
                if unknown := given.keys() - self.gains.keys():
                    self.reason = f"no gain {', '.join(sorted(unknown))}"
                else:
                    self.gains |= given
            elif action == 5:
                self.calibrations += 1
        self.report()
