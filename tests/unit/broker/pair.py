"""Two members that exchange signed beacons."""

from typing import Final

import msgspec
from tests.simulation.directory.replay_window import ReplayWindow
from tests.unit.broker.signed_beacons import Member, MemberKeys, SealedBeacon

from swarmd.broker.core.admission.sources import (
    Sources,
    Verdict,
)
from swarmware.model.names import hardware_id

MS: Final = 1_000_000


PERIOD: Final = 100 * MS


FALSE: Final = b"false"


NAMES: Final = {hardware_id(name): name for name in ("uav1", "uav2", "uav3")}


class Receiver:
    """The sources of one receiver, with a replay window that takes every number once."""

    def __init__(self) -> None:
        self.sources = Sources(MemberKeys("uav2"), lambda hw: NAMES.get(hw, ""))
        self._window = ReplayWindow()

    def take(self, sent: SealedBeacon, now_ns: int) -> Verdict | None:
        """None: the replay window refuses it."""
        header = sent.header
        is_new = self._window.is_new(header, sent.datagram.digest, self.sources, now_ns)
        if is_new is None:
            return None
        datagram = msgspec.structs.replace(sent.datagram, is_new=is_new)
        is_signed = self.sources.is_signed(header, sent.beacon, datagram)
        verdict = self.sources.judge(header, sent.beacon, datagram, is_signed, now_ns)
        if verdict.continues_at is not None:
            self._window.resume(verdict.continues_at)
        return verdict


class Pair:
    """A true sender, a member that forges in its name, and a receiver."""

    def __init__(self, steps: int = 20) -> None:
        self.victim = Member("uav1")
        self.forger = Member("uav1", key="uav3", host="10.0.0.9")
        self.receiver = Receiver()
        self.now_ns = 0
        self.sequence = 100
        for _ in range(steps):
            assert self.true().is_taken

    def true(self, *, signed: bool | None = None, lost: bool = False) -> Verdict:
        """The next beacon of the true sender; a verdict that takes none where the window refuses it."""
        self.now_ns += PERIOD
        self.sequence += 1
        sent = self.victim.beacon(self.sequence, self.now_ns, signed=signed)
        if lost:
            return Verdict(is_taken=False)
        return self.receiver.take(sent, self.now_ns) or Verdict(is_taken=False, refusal="replayed")

    def false(self, sequence: int, *, signed: bool = False) -> Verdict:
        sent = self.forger.beacon(sequence, self.now_ns, signed=signed, content=FALSE)
        return self.receiver.take(sent, self.now_ns) or Verdict(is_taken=False, refusal="replayed")
