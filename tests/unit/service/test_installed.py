"""Services are found by entry point; unknown names and other objects are refused with their names."""

import pytest

from swarmware.errors import ConfigError, NotFound, SwarmError
from swarmware.footprint.entry_points import EntryPoint
from swarmware.service import installed as installed_services
from swarmware.service.installed import find, installed
from swarmware.service.service import Service


class Probe(Service):
    """A service of a user."""

    name = "probe"

    async def run(self) -> None:
        raise AssertionError("never run here")


not_a_class = Probe.run


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {
        "probe": f"{__name__}:Probe",
        "other": f"{__name__}:Probe",
        "strange": f"{__name__}:not_a_class",
        "plain": "pathlib:Path",
    }
    points = {name: EntryPoint(name, value, "swarmware.services") for name, value in values.items()}
    monkeypatch.setattr(installed_services, "installed", lambda: points)


def test_an_installed_service_is_found_by_its_name() -> None:
    assert find("probe") is Probe


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("prob", NotFound, "service 'prob': not installed; did you mean probe?"),
        ("xyz", NotFound, "service 'xyz': not installed; expected one of probe, other, strange, plain"),
        ("", NotFound, "service '': not installed"),
        ("strange", ConfigError, "service 'strange': .*:not_a_class is not a Service"),
        ("plain", ConfigError, "service 'plain': pathlib:Path is not a Service"),
        ("other", ConfigError, "service 'other': .*:Probe is named 'probe'; expected one name"),
    ],
)
def test_foreign_object_is_not_service_of_name(name: str, error: type[SwarmError], message: str) -> None:
    with pytest.raises(error, match=message):
        find(name)


def test_our_own_daemons_are_installed() -> None:
    assert {"broker", "guard", "health", "tree"} <= installed().keys()
