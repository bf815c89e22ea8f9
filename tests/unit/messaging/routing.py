"""A message router with the addresses that it knows."""

from swarmware.model import names
from swarmware.transport.messaging.router import (
    MessageRouter,
    Takes,
)
from swarmware.types.time import Conversion

HERE, THERE = names.hardware_id("uav1"), names.hardware_id("uav7")


OWN_APP, OTHER_APP, LEFT_APP = 5, 6, 7


MESSAGES, REQUESTS, ELSEWHERE, NOWHERE = 11, 12, 13, 14


OWN, OTHER, BROKER = "ipc:///run/own", "ipc:///run/other", "ipc:///run/broker"


S = 1_000_000_000


VIA = "connection"


def make_router(*, broker: str | None = BROKER, gateway: bool = False) -> MessageRouter:
    """Own application 5 takes messages 11 and requests 12; application 6, in another process, takes 13."""
    router = MessageRouter(platform="uav1", hardware=HERE, address=OWN, conversion=conversion)
    router.has_gateway = gateway
    router.add_application(OWN_APP)
    router.serve(MESSAGES, OWN_APP, Takes.MESSAGES)
    router.serve(REQUESTS, OWN_APP, Takes.REQUESTS)
    served = {MESSAGES: OWN, REQUESTS: OWN, ELSEWHERE: OTHER}
    router.on_applications({OWN_APP: OWN, OTHER_APP: OTHER}, served, broker, 0)
    return router


def conversion(hardware: int) -> Conversion | None:
    """The clock of uav7 is ten seconds ahead; no other is known."""
    if hardware != THERE:
        return None
    return Conversion("uav7", "main", THERE, 1, 10 * S, 0.0, 0, 0, 0, 0.0, 1)
