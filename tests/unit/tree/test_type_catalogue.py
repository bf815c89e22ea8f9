"""The tree knows the common types, the types of running applications, and types that it has kept."""

import msgspec
import pytest

from swarmd.tree.operator import type_catalogue
from swarmd.tree.operator.type_catalogue import TypeCatalogue
from swarmware.errors import NotFound, WireError
from swarmware.transport.appfile.entry import AppEntry
from swarmware.types.description import describe
from swarmware.types.vehicle import Pose


class Rain(msgspec.Struct):
    mm: float


def application(types: dict[str, str]) -> AppEntry:
    return AppEntry(name="a", instance=1, pid=2, pid_start=3, endpoint="ipc://x", started_ns=4, types=types)


RAIN = application({"Rain": msgspec.json.encode(describe(Rain)).decode()})


def test_application_type_outlives_its_application() -> None:
    running = [RAIN]
    catalogue = TypeCatalogue("uav1", running)
    assert catalogue.description("Rain") == describe(Rain)
    running.clear()
    assert catalogue.description("Rain") == describe(Rain)
    assert catalogue.cls("Rain")(mm=1.5).mm == 1.5  # type: ignore[attr-defined]  # made at run time
    assert catalogue.cls("Rain") is catalogue.cls("Rain")


def test_a_common_type_needs_no_application() -> None:
    catalogue = TypeCatalogue("uav1", [])
    assert catalogue.description("Pose") == describe(Pose)
    assert catalogue.cls("Pose") is Pose


def test_unknown_type_is_missing_invalid_description_refused() -> None:
    catalogue = TypeCatalogue("uav1", [application({"Rain": "{}", "Snow": "["})])
    for name in ("Rain", "Snow"):
        with pytest.raises(WireError, match=f"{name!r} of a#1: not a description"):
            catalogue.description(name)
    with pytest.raises(NotFound, match="'Hail'"):
        catalogue.cls("Hail")


def test_descriptions_of_others_are_kept_up_to_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type_catalogue, "KEPT", 2)
    catalogue = TypeCatalogue("gcs", [])
    for name in ("A", "B", "C"):
        catalogue.keep("uav1", name, describe(Rain))
    assert catalogue.kept("uav1", "C") == describe(Rain)
    with pytest.raises(NotFound, match="uav1 has not described it"):
        catalogue.kept("uav1", "A")
