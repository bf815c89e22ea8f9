"""Processor time of end-to-end signatures: at the origin, a relay and the receiver of a forwarded frame.

    python tests/bench/signature.py [--json]

The real objects of the broker in one process, the least of several rounds of a thousand frames. Without: the
same step for a frame whose next hop is its receiver, which is not signed.
"""

import argparse
import json
import time
from collections.abc import Callable
from typing import Final

from swarmd.broker.core.frames.end_to_end import EndToEnd
from swarmd.broker.core.membership.origins import answer_to
from swarmware.model.frame import Frame, FrameKind, decode, encode
from swarmware.model.names import hardware_id
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.delivery.signature import with_node
from swarmware.transport.sodium import SigningKey
from swarmware.types.traffic import Refused

ROUNDS: Final = 9
FRAMES: Final = 1000
PAYLOAD_BYTES: Final = 200
NAMES: Final = ("gcs", "uav1", "uav2")
GCS, UAV1, UAV2 = map(hardware_id, NAMES)
KEYS: Final = {name: SigningKey(name.encode().ljust(32)) for name in NAMES}
BY_HW: Final = {hardware_id(name): name for name in NAMES}


class Ring:
    """The keys of one member."""

    is_open = False

    def __init__(self, name: str) -> None:
        self._key = KEYS[name]

    def sign(self, data: bytes) -> bytes:
        """The signature of this member."""
        return self._key.sign(data)

    def sign_public_of(self, platform: str) -> bytes | None:
        """The public key of a member."""
        return KEYS[platform].public


def end_of(name: str) -> EndToEnd:
    """One member's end."""
    return EndToEnd(hardware_id(name), 1, Ring(name), lambda hw: BY_HW[hw], Refused())


def least_us(step: Callable[[], object]) -> float:
    """Processor time of one step."""
    least_ns = min(_round_ns(step) for _ in range(ROUNDS))
    return round(least_ns / FRAMES / 1000, 2)


def _round_ns(step: Callable[[], object]) -> int:
    started_ns = time.process_time_ns()
    for _ in range(FRAMES):
        step()
    return time.process_time_ns() - started_ns


def measure() -> dict[str, float]:
    """All steps."""
    origin, receiver = end_of("gcs"), end_of("uav1")
    frame = Frame(
        FrameKind.MESSAGE, 5, GCS, 1, UAV1, 2, extension=with_lifetime(2.0), payload=bytes(PAYLOAD_BYTES)
    )
    signed = origin.signed(frame, UAV2)
    [question] = receiver.on_frame(_arriving(signed), UAV2, True, 0).outgoing
    check = answer_to(bytes(question.payload))
    assert check is not None
    reply = Frame(FrameKind.HELLO, 0, GCS, 0, UAV1, 0, payload=check)
    assert receiver.on_frame(_arriving(origin.signed(reply, UAV2)), UAV2, True, 0).arrivals
    bare, data = encode(frame), encode(signed)

    def forward(encoded: bytes) -> bytes:
        passing = decode(encoded)
        passing.hops_left -= 1
        passing.extension = with_node(passing.extension, UAV2)
        return encode(passing)

    return {
        "origin_unsigned_us": least_us(lambda: encode(origin.signed(frame, UAV1))),
        "origin_signed_us": least_us(lambda: encode(origin.signed(frame, UAV2))),
        "relay_unsigned_us": least_us(lambda: forward(bare)),
        "relay_signed_us": least_us(lambda: forward(data)),
        "receiver_unsigned_us": least_us(lambda: receiver.on_frame(decode(bare), GCS, True, 0)),
        "receiver_signed_us": least_us(lambda: receiver.on_frame(_arriving(signed), UAV2, True, 0)),
    }


def _arriving(frame: Frame) -> Frame:
    arriving = decode(encode(frame))
    arriving.extension = with_node(arriving.extension, UAV2)
    return arriving


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = measure()
    if options.json:
        print(json.dumps(found))
        return
    for name, time_us in found.items():
        print(f"{name.removesuffix('_us').replace('_', ' '):20s} {time_us:7.2f} µs")


if __name__ == "__main__":
    main()
