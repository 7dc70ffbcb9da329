"""Check whether the yaw-rate signal is a yaw rate in the right unit and sign.

In: the signal and the yaw rate that the filter estimates, which is the wheels' by its radii and load
transfer. Out: trusted or not. A DBC that states deg/s for rad/s, a sensor mounted upside down or one that is
frozen would otherwise bend every radius difference.

Running regression of that yaw rate on the signal, with an intercept for the bias, over the last minutes of
driving: trusted is a slope near one, after enough bends to tell. That way round, because the counters'
quantisation makes the wheels the noisier of the two, and noise in the explaining variable would flatten the
slope.
"""

from __future__ import annotations

import math

from tpmsd.onboard.estimators.settings import SETTINGS


class GyroCheck:
    """Regression with exponential forgetting."""

    def __init__(self) -> None:
        self._weight = self._gyro = self._wheels = self._square = self._product = 0.0

    def update(self, gyro_radps: float, wheels_radps: float, dt_s: float) -> None:
        """Update the regression by one tick of driving; NaN is left out."""
        if not math.isfinite(gyro_radps + wheels_radps):
            return
        keep = math.exp(-dt_s / SETTINGS.gyro_memory_s)
        self._weight = keep * self._weight + dt_s
        self._gyro = keep * self._gyro + gyro_radps * dt_s
        self._wheels = keep * self._wheels + wheels_radps * dt_s
        self._square = keep * self._square + gyro_radps**2 * dt_s
        self._product = keep * self._product + wheels_radps * gyro_radps * dt_s

    @property
    def slope(self) -> float:
        """Slope of the wheels' yaw rate over the signal, 1 for a true one; NaN before enough bends."""
        if self._weight <= 0.0:
            return math.nan
        excitation = self._square - self._gyro**2 / self._weight
        if excitation < SETTINGS.gyro_excitation:
            return math.nan
        return (self._product - self._wheels * self._gyro / self._weight) / excitation

    @property
    def trusted(self) -> bool:
        """True if the signal may be used."""
        least, most = SETTINGS.gyro_slope_range
        return least <= self.slope <= most  # false for NaN
