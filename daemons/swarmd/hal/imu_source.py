"""Base of drivers that publish the samples of an inertial unit, corrected by its calibration."""

from swarmd.hal.core.imu_calibration import ImuCorrection, ImuCorrector
from swarmware.types.vehicle import Imu


class ImuSource:
    """Base of the drivers of inertial units; each sample passes `corrected`."""

    _corrector = ImuCorrector()
    collected: list[Imu] | None = None
    """Uncorrected samples while a calibration collects them, else None."""

    @property
    def correction(self) -> ImuCorrection:
        """The correction in force."""
        return self._corrector.correction

    @correction.setter
    def correction(self, correction: ImuCorrection) -> None:
        self._corrector = ImuCorrector(correction)

    def corrected(self, imu: Imu) -> Imu:
        """The sample with the correction applied; collects the uncorrected sample during a calibration."""
        if self.collected is not None:
            self.collected.append(imu)
        return self._corrector.apply(imu)
