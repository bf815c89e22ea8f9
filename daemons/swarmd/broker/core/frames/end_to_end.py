"""Signatures of relayed frames: the origin signs, the receiver verifies; relays do neither."""

from collections.abc import Callable
from typing import Final

import msgspec

from swarmd.broker.core.frames import frame_datagram
from swarmd.broker.core.membership.origins import Freshness, Origins, answer_to, is_check
from swarmd.broker.core.membership.signatures.own_signatures import SigningKeys
from swarmware.errors import WireError
from swarmware.model.frame import Frame, FrameKind
from swarmware.transport.delivery import signature
from swarmware.transport.delivery.answer import lifetime_ns
from swarmware.transport.delivery.outcome import Status
from swarmware.transport.delivery.signature import FrameSignature, RelayExtension
from swarmware.transport.sodium import verify
from swarmware.types import registry
from swarmware.types.rpc import Ack
from swarmware.types.traffic import Refused

_UNREACHABLE: Final = int(Status.UNREACHABLE)


class AuthenticatedFrame(msgspec.Struct, frozen=True):
    """A frame for this node, whose sender is authenticated."""

    frame: Frame
    path: tuple[int, ...]
    """Nodes that forwarded it, the first one first."""
    arrived_ns: int
    first: bool
    """The frame was not received before."""


class Incoming(msgspec.Struct, frozen=True):
    """Consequences of a frame for this node."""

    arrivals: tuple[AuthenticatedFrame, ...] = ()
    """Frames to be delivered."""
    outgoing: tuple[Frame, ...] = ()
    """Frames of this node to be sent."""
    refusal: str = ""
    """Reason for which the frame was refused, or "" if it was not."""


class EndToEnd:
    """Signs the frames that others will forward, and verifies those that others have forwarded."""

    def __init__(
        self,
        own_hw: int,
        session: int,
        keys: SigningKeys,
        platform_of: Callable[[int], str],
        refused: Refused,
    ) -> None:
        self._own_hw = own_hw
        self._session = session
        self._keys = keys
        self._platform_of = platform_of
        self._refused = refused
        self._origins: Origins[AuthenticatedFrame] = Origins(session)
        self._checks = 0
        """Number of the last question or answer: links drop a frame that is in flight already."""

    def signed(self, frame: Frame, via: int) -> Frame:
        """The frame as it is sent to this next hop: signed, unless that is its receiver.

        Raises: WireError when its header extension has no room for the signature.
        """
        if self._keys.is_open:
            return frame
        # the seal of the pair authenticates its sender, so this hop needs no signature
        if via == frame.receiver_hw and frame.sender_hw == self._own_hw and frame.kind is not FrameKind.HELLO:
            return frame
        # compressed now: no node on the path may change what is signed
        frame = frame_datagram.compressed(frame, signature.SIGNATURE_ELEMENT_BYTES)
        extension = signature.signed_extension(frame, self._own_hw, self._session, self._keys.sign)
        return msgspec.structs.replace(frame, extension=extension)  # the sender may send its own one again

    def on_frame(self, frame: Frame, link_hw: int | None, first: bool, now_ns: int) -> Incoming:
        """Take a frame for this node; `link_hw`: the authenticated end of the link that it came over, None
        without keys."""
        is_direct = self._keys.is_open or (link_hw == frame.sender_hw and frame.kind is not FrameKind.HELLO)
        if is_direct and frame.kind is not FrameKind.HELLO and not signature.is_relayed(frame.extension):
            return Incoming((AuthenticatedFrame(frame, (), now_ns, first),))  # most frames
        try:
            parts = signature.split(frame.extension)
        except WireError:
            self._refused.malformed += 1
            return Incoming()
        frame.extension = parts.extension
        arrival = AuthenticatedFrame(frame, parts.path, now_ns, first)
        if is_direct:
            return Incoming() if frame.kind is FrameKind.HELLO else Incoming((arrival,))
        if link_hw not in (None, frame.sender_hw) and (not parts.path or parts.path[-1] != link_hw):
            # this one is certain; each states itself and could invent those before it
            arrival = msgspec.structs.replace(arrival, path=(*parts.path, link_hw))
        return self._relayed(arrival, parts, now_ns)

    def _relayed(self, arrival: AuthenticatedFrame, parts: RelayExtension, now_ns: int) -> Incoming:
        frame, found = arrival.frame, parts.signature
        name = self._platform_of(frame.sender_hw)
        if found is None:
            self._refused.unsigned += 1
            return Incoming(refusal=f"frame of {name}: not signed")
        # any other content could be invented by the node that signed it
        if found.signer_hw != frame.sender_hw and not _is_hop_refusal(frame):
            self._refused.spoofed += 1
            return Incoming(refusal=f"frame of {name}: signed by {self._platform_of(found.signer_hw)}")
        public = self._keys.sign_public_of(self._platform_of(found.signer_hw))
        if public is None or not verify(public, found.value, signature.signed_content(frame, parts)):
            self._refused.spoofed += 1
            return Incoming(refusal=f"frame of {name}: the signature is not of {name}")
        if found.signer_hw != frame.sender_hw:
            return Incoming((arrival,))
        if frame.kind is FrameKind.HELLO:
            return self._on_check(frame, found, now_ns)
        return self._if_current(arrival, found, now_ns)

    def _if_current(self, arrival: AuthenticatedFrame, found: FrameSignature, now_ns: int) -> Incoming:
        frame = arrival.frame
        freshness = self._origins.judge(
            frame.sender_hw, found.session, frame.stamp_ns, lifetime_ns(frame.extension), now_ns
        )
        if freshness is Freshness.CURRENT:
            return Incoming((arrival,))
        question = self._question(frame.sender_hw, now_ns)
        # the frame waits for the answer; its sender would repeat it only after a time-out
        if freshness is Freshness.UNKNOWN:
            self._origins.hold(frame.sender_hw, found.session, arrival)
            return Incoming(outgoing=question)
        self._refused.replayed += 1
        name = self._platform_of(frame.sender_hw)
        return Incoming(outgoing=question, refusal=f"frame of {name}: made long ago; a replay, or delayed")

    def _on_check(self, frame: Frame, found: FrameSignature, now_ns: int) -> Incoming:
        check, origin = bytes(frame.payload), frame.sender_hw
        if not is_check(check):
            self._refused.malformed += 1
            return Incoming()
        answer = answer_to(check)
        if answer is not None:
            reply = self._check_frame(origin, answer, now_ns)
            # its session is known already; otherwise this node asks in turn, before frames of it arrive
            if self._origins.is_confirmed(origin, found.session):
                return Incoming(outgoing=(reply,))
            return Incoming(outgoing=(reply, *self._question(origin, now_ns)))
        arrivals: list[AuthenticatedFrame] = []
        # judged again with the clock that the answer shows; a held frame may be a replay
        for held in self._origins.on_answer(origin, found.session, check, frame.stamp_ns, now_ns):
            waited = held.frame
            freshness = self._origins.judge(
                origin, found.session, waited.stamp_ns, lifetime_ns(waited.extension), now_ns
            )
            if freshness is Freshness.CURRENT:
                arrivals.append(held)
            else:
                self._refused.replayed += 1
        return Incoming(tuple(arrivals))

    def _question(self, origin: int, now_ns: int) -> tuple[Frame, ...]:
        question = self._origins.question(origin, now_ns)
        return () if question is None else (self._check_frame(origin, question, now_ns),)

    def _check_frame(self, origin: int, payload: bytes, now_ns: int) -> Frame:
        self._checks = self._checks + 1 & 0xFFFF_FFFF
        return Frame(FrameKind.HELLO, 0, self._own_hw, 0, origin, 0, self._checks, now_ns, payload=payload)


def _is_hop_refusal(frame: Frame) -> bool:
    """Whether a node on the path may say this for the receiver: only that it cannot be reached now."""
    if frame.kind is not FrameKind.ACK:
        return False
    try:
        return registry.decode(Ack, frame.payload, frame.codec).status == _UNREACHABLE
    except WireError:
        return False
