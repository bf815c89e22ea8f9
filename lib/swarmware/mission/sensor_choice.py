"""Choice of the sensor of a WaitForSensor, and the check whether its value is enough."""

import msgspec

from swarmware.mission.catalogue import WaitForSensor
from swarmware.mission.condition_parser import parse as parse_condition
from swarmware.mission.field_path import Scalar, scalar_of
from swarmware.mission.resource_params import VALUE, Params, WaitForResource
from swarmware.model.names import Pattern


def sought(params: Params) -> WaitForSensor | None:
    """The sensors or other boards for which a block with these parameters waits, or None if it does not."""
    if isinstance(params, WaitForResource):
        return WaitForSensor(sensor=params.path, until=params.until)
    return params if isinstance(params, WaitForSensor) else None


class SensorChoice:
    """Chooses sensors by path and by what they measure, and judges their values."""

    def __init__(self, params: WaitForSensor) -> None:
        self._params = params
        self._pattern = Pattern(params.sensor)
        self._until = parse_condition(params.until, VALUE) if params.until else None

    @property
    def pattern(self) -> str:
        """Pattern of the local paths of the sensors that are meant."""
        return self._params.sensor

    def __str__(self) -> str:
        measures = f" that measures {self._params.measures}" if self._params.measures else ""
        until = f" with {self._params.until}" if self._params.until else ""
        return f"sensor {self._params.sensor}{measures}{until}"

    def means(self, path: str, cls: type[msgspec.Struct] | None) -> bool:
        """Whether the resource is one of those meant; without a known type only by its path."""
        if not self._pattern.matches(path):
            return False
        measures = self._params.measures
        if cls is None or not measures:
            return not measures
        return measures == cls.__name__ or measures in cls.__struct_fields__

    def suffices(self, value: msgspec.Struct, age_s: float, fresh_s: float) -> bool:
        """Whether a value of such a sensor, of this age, ends the wait."""
        if age_s > fresh_s:
            return False
        return self._until is None or self._until.holds(SingleValue(value, age_s)) is True


class SingleValue(msgspec.Struct, frozen=True):
    """A value, as the source of a condition on its fields."""

    whole: msgspec.Struct
    age: float = 0.0

    def value(self, path: str, field: str) -> Scalar | None:
        """A field of the value."""
        return scalar_of(self.whole, field)

    def age_s(self, path: str) -> float | None:
        """Age of the value."""
        return self.age
