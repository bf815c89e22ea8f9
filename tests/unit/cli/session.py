"""A session whose swarm is a table of answers, and the values that tests put there."""

import io
import json
from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec

from swarmctl.commandline.settings import CliSettings
from swarmctl.session.session import Session
from swarmctl.terminal.output import Output
from swarmware.errors import NotFound, SwarmError
from swarmware.model.resource import Kind
from swarmware.testing.client import FakeClient
from swarmware.types.mission import OrderReceipt
from swarmware.types.net import Routes, RouteState
from swarmware.types.tree import (
    TreeEntry,
    TreeListing,
    TreeValue,
)

R = TypeVar("R", bound=msgspec.Struct)


GET, SET, UNDO, RESET = (f"/uav1/sys/tree/{verb}" for verb in ("get", "set", "undo", "reset"))


COPY, LIST = "/gcs/sys/tree/get", "/gcs/sys/tree/list"


GAIN = "/uav1/config/gain"


class ScriptedSession(Session):
    """Answers by path, or by path and resource; an error among them is raised. Keeps the requests."""

    def __init__(
        self, answers: Mapping[str, Any], client: FakeClient | None = None, /, **options: Any
    ) -> None:
        self.stdout, self.stderr = io.StringIO(), io.StringIO()
        settings = CliSettings(**options)
        super().__init__(client or FakeClient(), settings, Output(settings, self.stdout, self.stderr))
        self.answers = answers
        self.asked: list[str] = []

    async def ask(
        self,
        path: str,
        value: msgspec.Struct,
        reply: type[R],
        *,
        about: str = "",
        timeout_s: float | None = None,
    ) -> R:
        self.asked.append(path)
        if path == COPY and f"{path} {about}".strip() not in self.answers:
            raise NotFound(f"{about}: gcs has no copy of it")
        found = self.answers[f"{path} {about}".strip()]
        if isinstance(found, SwarmError):
            raise found
        assert isinstance(found, reply), path
        return found

    def age_s(self, platform: str, stamp_ns: int) -> float | None:
        return None

    async def routes(self) -> Routes:
        route = RouteState("uav1", 1, "uav1", 256, 1, 1, 0)
        return Routes((route,))

    async def known(self) -> tuple[str, ...]:
        return ("gcs", "uav1")

    async def reach(self, platform: str) -> None:
        assert platform in {"gcs", "uav1"}

    @property
    def document(self) -> Any:
        return json.loads(self.stdout.getvalue())


def value(path: str, number: float, **more: Any) -> TreeValue:
    data = msgspec.msgpack.encode([number])
    known: dict[str, Any] = {
        "stamp_ns": 1,
        "sequence": 1,
        "version": 1,
        "age_s": 0.25,
        "quality": "live",
        "unit": "m",
    }
    return TreeValue(path, "Float", data, **(known | more))


def listing(*paths: str, confirm: str = "") -> TreeListing:
    entries = [
        TreeEntry(path, Kind.SETTING, "Float", unit="m", access="rw", confirm=confirm) for path in paths
    ]
    return TreeListing(tuple(entries))


def receipt(platform: str, *, accepted: bool) -> OrderReceipt:
    return OrderReceipt("formation", 1, platform, "member", 10, 20 if accepted else 0, 15, accepted)
