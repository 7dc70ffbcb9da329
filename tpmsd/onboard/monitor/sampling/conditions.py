"""Under which conditions the car rolls: what its radii depend on while nothing is wrong with a tyre.

In: ticks and estimates. Out: `Conditions`: speed, slope and coldness of the tyres, as far behind the present
as the estimates are. An estimate of a radius is a mean over its filter's memory; what it is held against must
be a mean over the same time. The memory follows from the estimate itself: a random walk of q per square root
of a second that is known with the variance P is known by the last P / q^2 seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from tpmsd.car.physics.grade import GradeTracker
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.bounds import LARGEST, number
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.monitor.settings import CONDITIONS
from tpmsd.onboard.timeline.tick import Tick


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions that the radii are functions of, over the estimate's memory."""

    speed2: float
    """Speed squared, (m/s)^2."""
    slope_mps2: float
    """g sin(grade): what the driven wheels must carry beyond the acceleration itself."""
    cold: tuple[float, float]
    """Coldness of the tyres, 1 cold to 0 warm, for each time constant of warm-up."""
    steep_mps2: float
    """The steepest slope of late, up or down, as g sin(grade); fades with the estimate's memory."""
    unsettled: float
    """Present minus remembered speed squared, (m/s)^2: what the memory has not followed yet."""


class ConditionTracker:
    """Follows the conditions; says when the car has stood so long that load or day may be others."""

    def __init__(self) -> None:
        self._grade = GradeTracker()
        self._speed2 = math.nan
        self._slope = 0.0
        self._steep = 0.0
        self._present2 = 0.0
        self._cold = [1.0] * len(CONDITIONS.warming_s)
        self._stood_s = 0.0
        self._time_s = math.nan

    @property
    def now(self) -> Conditions:
        """The conditions now."""
        speed2 = 0.0 if math.isnan(self._speed2) else self._speed2
        cold = (self._cold[0], self._cold[1])
        return Conditions(speed2, self._slope, cold, self._steep, self._present2 - speed2)

    def update(self, tick: Tick, estimate: RadiusEstimate) -> float:
        """Update by one tick; return for how long the car had stood (s) if it sets off with it, else 0."""
        if math.isfinite(self._time_s):
            self._add_standstill(max(tick.time_s - tick.dt_s - self._time_s, 0.0))
        self._time_s = tick.time_s
        speed = estimate.speed_mps
        if not math.isfinite(speed) or speed < CONDITIONS.standstill_mps:
            self._add_standstill(tick.dt_s)
            return 0.0
        self._cold = [
            c * math.exp(-tick.dt_s / tau) for c, tau in zip(self._cold, CONDITIONS.warming_s, strict=True)
        ]
        if tick.gap_s > 0.0:
            self._grade.reset()
        self._grade.move(speed * tick.dt_s)
        for fix in tick.fixes:
            self._grade.update(fix.up_m)
        share = 1.0 - math.exp(-tick.dt_s / _memory_s(estimate))
        self._steep = max(abs(GRAVITY_MPS2 * self._grade.sine), self._steep * (1.0 - share))
        self._present2 = speed * speed
        if math.isnan(self._speed2):
            self._speed2 = self._present2
        if estimate.informative:  # in other ticks the estimate learns nothing
            self._speed2 += share * (self._present2 - self._speed2)
            self._slope += share * (GRAVITY_MPS2 * self._grade.sine - self._slope)
        stood_s, self._stood_s = self._stood_s, 0.0
        return stood_s

    def _add_standstill(self, seconds: float) -> None:
        """Add seconds of standstill, in which the tyres cool."""
        self._stood_s += seconds
        self._cold = [1.0 - (1.0 - c) * math.exp(-seconds / CONDITIONS.cooling_s) for c in self._cold]

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers for the state file."""
        time_s = self._time_s if math.isfinite(self._time_s) else None
        speed2 = self._speed2 if math.isfinite(self._speed2) else None
        return {
            "cold": list(self._cold),
            "stood_s": self._stood_s,
            "time_s": time_s,
            "speed2": speed2,
            "present2": self._present2,
            "slope": self._slope,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore what `to_json` returned; ValueError if it is nothing of that kind.

        Until the next tick the car is taken to have stood: the daemon ran on for as long as it was driven.
        """
        try:
            cold = [number(c, 0.0, 1.0, "coldness of the tyres") for c in saved["cold"]]
            stood_s = number(saved["stood_s"], 0.0, LARGEST, "standstill")
            time_s = (
                math.nan if saved["time_s"] is None else number(saved["time_s"], -LARGEST, LARGEST, "time")
            )
            speed2 = (
                math.nan
                if saved["speed2"] is None
                else number(saved["speed2"], 0.0, CONDITIONS.max_speed2, "speed")
            )
            present2 = number(saved["present2"], 0.0, CONDITIONS.max_speed2, "speed")
            slope = number(saved["slope"], -GRAVITY_MPS2, GRAVITY_MPS2, "slope")
        except (KeyError, TypeError) as error:
            raise ValueError(f"the saved conditions are none: {error}") from error
        if len(cold) != len(CONDITIONS.warming_s):
            raise ValueError("the saved conditions are none")
        self._cold, self._stood_s, self._time_s = cold, stood_s, time_s
        self._speed2, self._present2, self._slope = speed2, present2, slope


def _memory_s(estimate: RadiusEstimate) -> float:
    """Return the time (s) that the estimate of a change common to all wheels is a mean over."""
    # Plain numbers: for so few numpy takes ten times as long, and this is asked every tick.
    spread = estimate.covariance_m2.tolist()
    variance = sum(map(sum, spread)) / 16.0
    if not math.isfinite(variance):
        # Unestimated wheels are NaN in all of their rows and columns.
        known = [one for row in spread for one in row if math.isfinite(one)]
        if not known:
            return CONDITIONS.memory_s[1]
        variance = sum(known) / len(known)
    return min(max(variance / SETTINGS.drift_common_m**2, CONDITIONS.memory_s[0]), CONDITIONS.memory_s[1])
