"""The video daemon: starts and ends sessions on request or by rules, and publishes their changes."""

import asyncio
import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Final

from swarmd.video import config as settings
from swarmd.video.codec import pyav
from swarmd.video.core.channel_video import Channel, ChannelVideo, StartVideo
from swarmd.video.core.destination import Destination, session_description
from swarmd.video.core.session_table import SessionKey, SessionTable
from swarmd.video.receiving import ReceivingSession
from swarmd.video.rtp_socket import RtpSocket, SwarmPath, resolve
from swarmd.video.sending import Receiver, SendingSession
from swarmd.video.sources import PictureSource, open_source
from swarmware.errors import Conflict, Denied, NoAnswer, NotFound, SwarmError
from swarmware.model import names
from swarmware.model.names import Address
from swarmware.model.resource import Kind
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.service.service import Service
from swarmware.types import registry
from swarmware.types.channel import ChannelLimits
from swarmware.types.net import Routes
from swarmware.types.perception import Image
from swarmware.types.rpc import Empty
from swarmware.types.video import (
    RtpDatagram,
    VideoChange,
    VideoOpen,
    VideoOpened,
    VideoRate,
    VideoSession,
    VideoSessions,
    VideoStart,
    VideoStop,
)

DATAGRAMS: Final = "sys/video/rtp"
OPEN: Final = "sys/video/open"
CHECK_S: Final = 1.0
"""Period of the check for sessions whose other end is silent."""


class Video(Service):
    """Sends video of this node's sources, and receives video of other platforms."""

    name = "video"
    Config = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        self._table: SessionTable[SendingSession, ReceivingSession] = SessionTable(config.sessions_max)
        self._tasks: dict[int | SessionKey, asyncio.Task[None]] = {}
        self._reasons: dict[int | SessionKey, str] = {}
        """Reasons for which sessions are being ended."""
        self._limits = module.reader("net/limits", ChannelLimits)
        self._routes = module.reader("net/routes", Routes)
        self._by_rules = ChannelVideo()
        self._address = Address(module.node.platform, module.node.config.unit)
        self._changes = module.stream_writer(
            "video/changes",
            VideoChange,
            kind="event",
            log="all",
            link="notify",
            description="Each start, change and end of a video session",
        )
        module.take_datagrams(
            DATAGRAMS, RtpDatagram, self._on_datagram, description="Packets of video sessions"
        )
        module.serve(
            "sys/video/start",
            VideoStart,
            self._start,
            reply=VideoSession,
            description="Send a source as video",
        )
        module.serve(
            "sys/video/rate", VideoRate, self._rate, reply=VideoSession, description="Rate of a video session"
        )
        module.serve(
            "sys/video/stop", VideoStop, self._stop, reply=VideoSessions, description="End a video session"
        )
        module.serve("sys/video/ls", Empty, self._list, reply=VideoSessions, description="Video sessions")
        module.serve(
            OPEN,
            VideoOpen,
            self._open,
            reply=VideoOpened,
            description="Prepare to receive video of the requester",
        )

    async def run(self) -> None:
        """Serves until cancelled, ends sessions whose other end is silent, and follows the rules of
        channels."""
        self.module.start(self._follow_rules(), "rules")
        limit_s = self.config.silence_s
        async for _ in self.module.every(CHECK_S):
            now_ns = self.module.now_ns()
            for key in list(self._tasks):
                session = self._session(key)
                if session.has_ended:
                    self._end(key, "ended by the other end")
                elif session.is_silent(now_ns):
                    self._end(key, f"ended: nothing arrived for {limit_s:g} s")

    async def _follow_rules(self) -> None:
        while True:
            if self._limits.value is not None:
                await self._apply_rules(self._limits.value)
            with suppress(NoAnswer):  # repeated without a change, because routes and sessions change as well
                await self._limits.changed(CHECK_S)

    async def _apply_rules(self, rules: ChannelLimits) -> None:
        now_ns = self.module.now_ns()
        # the usual case, once a second: nothing is listed or compared
        if not any(rule.settings.is_video for rule in rules.limits) and not self._by_rules.is_busy:
            return
        routes = self._routes.value or Routes()
        others = {one.platform for one in routes.routes} - {self._address.platform}
        sent = [Channel(*names_) for names_ in self._table.names_sent()]
        for action in self._by_rules.changes(rules.limits, self._sources(), others, sent, now_ns):
            channel = action.channel
            if not isinstance(action, StartVideo):
                number = self._table.number_sent(channel.source, channel.platform)
                if number is not None:
                    self._end(number, "ended: no rule of a channel asks for it")
                continue
            try:
                request = VideoStart(channel.source, channel.platform)
                await self._begin(request, "a rule of its channel", action.max_hz)
            except SwarmError as error:
                self._by_rules.on_failed(channel, self.module.now_ns())
                self.module.log.warning(
                    "video of %s to %s, by a rule of its channel: %s", channel.source, channel.platform, error
                )

    # -- requests

    async def _start(self, request: VideoStart, meta: Meta) -> VideoSession:
        return await self._begin(request, _asker(meta))

    async def _begin(self, request: VideoStart, by: str, max_hz: float | None = None) -> VideoSession:
        pyav()
        destination = Destination.parse(request.to)
        if names.platform_of(destination.platform) == self._address.platform:
            raise Conflict(
                f"video to {request.to}: the source is on the same platform; expected another platform"
            )
        self._table.check_sent(request.source, str(destination))
        self._check_source(request.source)
        # one thread for a session, so that its source and its encoder are used in order
        executor = ThreadPoolExecutor(1, "video-encoder")
        source: PictureSource | None = None
        try:
            configured = self.config.sources.get(request.source)
            source = await open_source(self.module, request.source, configured, executor)
            session = await self._opened(request, destination, source, executor, max_hz)
        except BaseException:
            if source is not None:
                source.close()
            executor.shutdown(wait=False)
            raise
        self._table.add_sent(session.number, request.source, str(destination), session.receiver_hw, session)
        self._run(session.number, session)
        self._record(session.number, request.source, str(destination), "started", by)
        return session.report()

    def _check_source(self, name: str) -> None:
        if name in self.config.sources:
            return
        names.check_path(name)
        known = self._sources()
        if name not in known:
            listed = ", ".join(sorted(known)) or "none"
            raise NotFound(f"source {name}: not known to {self._address}; expected one of: {listed}")

    def _sources(self) -> set[str]:
        """Names of the configured sources, and of the node's streams of images."""
        table = self.module.node.table
        table.refresh()
        images = {
            one.path
            for entry in table
            for one in entry.provides
            if one.kind is Kind.STREAM and one.type == registry.type_name(Image)
        }
        return images | set(self.config.sources)

    async def _opened(
        self,
        request: VideoStart,
        to: Destination,
        source: PictureSource,
        executor: ThreadPoolExecutor,
        max_hz: float | None,
    ) -> SendingSession:
        number = int.from_bytes(os.urandom(4))
        if to.platform:
            ask = VideoOpen(number, str(self._address), request.source)
            opened = await self.module.request(names.join(to.platform, OPEN), ask, VideoOpened)
            there = Address.parse(opened.receiver)
            path = SwarmPath(partial(self._post, there.path))
            receiver = Receiver(to, path, received_as=opened.path, hardware=there.hardware)
        else:
            family, host = await resolve(to.host, to.port)
            socket = RtpSocket(family, host, to.port, partial(self._on_report, number))
            described = session_description(number, request.source, host, to.port)
            receiver = Receiver(to, socket, described)
        return SendingSession(
            self.module,
            self.config,
            number,
            request,
            receiver,
            source=source,
            executor=executor,
            max_hz=max_hz,
        )

    def _open(self, request: VideoOpen, meta: Meta) -> VideoOpened:
        sender = Address.parse(request.sender)
        if sender.hardware != meta.sender_hw:
            raise Denied(f"video of {sender}: the request comes from another computer")
        names.check_path(request.source)
        replaced = self._table.replaced(request.source, str(sender))
        if replaced is not None:
            # a restarted sender has forgotten its old session, which otherwise lasts until its silence ends
            # it
            self._end(replaced, "ended: its sender has begun again")
        key = SessionKey(sender.hardware, request.session)
        session = ReceivingSession(
            self.module,
            request.session,
            sender,
            request.source,
            config=self.config,
            send=partial(self._post, sender.path),
        )
        self._table.add_received(key, request.source, str(sender), session)
        self._run(key, session)
        self._record(request.session, request.source, str(sender), "received", _asker(meta))
        return VideoOpened(str(self._address), session.path)

    def _rate(self, request: VideoRate, meta: Meta) -> VideoSession:
        session = self._table.sent.get(request.session)
        if session is None:
            raise NotFound(f"session {request.session}: not sent by {self._address}; see `video ls`")
        session.pin(request.max_bit_s, request.pinned)
        how = "pinned to" if request.pinned else "at most"
        change = f"{how} {request.max_bit_s / 1000:g} kbit/s"
        self._record(request.session, session.name, str(session.destination), change, _asker(meta))
        return session.report()

    def _stop(self, request: VideoStop, meta: Meta) -> VideoSessions:
        keys = [
            key
            for key in self._tasks
            if request.session == (key.session if isinstance(key, SessionKey) else key)
        ]
        if not keys:
            raise NotFound(f"session {request.session}: not of {self._address}; see `video ls`")
        reports = tuple(self._session(key).report() for key in keys)
        for key in keys:
            self._end(key, f"stopped by {_asker(meta)}")
        return VideoSessions(reports)

    def _list(self, _: Empty, __: Meta) -> VideoSessions:
        reports = tuple(self._session(key).report() for key in self._tasks)
        return VideoSessions(reports, self._table.refused)

    # -- packets

    def _on_datagram(self, datagram: RtpDatagram, sender_hw: int) -> None:
        session = self._table.find(datagram.data, sender_hw)
        if session is not None:
            session.on_packet(datagram.data)

    def _on_report(self, number: int, data: bytes) -> None:
        session = self._table.sent.get(number)
        if session is not None:
            session.on_packet(data)

    def _post(self, computer: str, data: bytes) -> None:
        self.module.post(names.join(computer, DATAGRAMS), RtpDatagram(data))

    # -- the life of a session

    def _session(self, key: int | SessionKey) -> SendingSession | ReceivingSession:
        return self._table.received[key] if isinstance(key, SessionKey) else self._table.sent[key]

    def _run(self, key: int | SessionKey, session: SendingSession | ReceivingSession) -> None:
        self._tasks[key] = self.module.start(self._until_end(key, session), f"session {session.number}")

    async def _until_end(self, key: int | SessionKey, session: SendingSession | ReceivingSession) -> None:
        reason = "ended"
        try:
            await session.run()
        except SwarmError as error:
            reason = f"ended: {error}"
            self.module.log.warning("video session %d: %s", session.number, error)
        finally:
            # a replaced session has left the table already, and its key may be in use again
            if self._tasks.get(key) is asyncio.current_task():
                self._forget(key)
            report = session.report()
            self._record(session.number, report.source, report.other, self._reasons.pop(key, reason), "")

    def _end(self, key: int | SessionKey, reason: str) -> None:
        self._reasons[key] = reason
        self._session(key).close()
        self._tasks[key].cancel()
        self._forget(key)

    def _forget(self, key: int | SessionKey) -> None:
        self._table.remove(key)
        self._tasks.pop(key, None)

    def _record(self, number: int, source: str, other: str, change: str, by: str) -> None:
        self.module.log.info("video session %d, %s, %s: %s", number, source, other, change)
        self._changes.write(VideoChange(number, source, other, change, by))


def _asker(meta: Meta) -> str:
    return "this platform" if meta.sender is None else str(meta.sender)
