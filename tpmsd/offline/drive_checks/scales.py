"""Scales of the wheels' signals: teeth and radius, units, and the modulus of a counter.

In: wheel signals as a configuration reads them, compared with the receiver. Out: suspicions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from scipy.stats import norm

from tpmsd.car.config.model import Config
from tpmsd.car.config.units import UNITS, canonical_unit
from tpmsd.car.rings.ring import counts_per_revolution, radius_from_counts_m
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.discovery.series import Series
from tpmsd.offline.discovery.settings import SETTINGS
from tpmsd.offline.discovery.wheels import Follower
from tpmsd.offline.drive_checks.suspicion import Suspicion

_UNITS = ("km/h", "m/s", "mph", "knots", "rpm", "rad/s")


def wrong_moduli(series: Mapping[str, Series]) -> list[Suspicion]:
    """Return a suspicion for each counter that rolls over at another number than is stated."""
    found = []
    for role, made in series.items():
        stated = int(made.field.unit.split()[1]) if made.kind == "count" else 0
        if made.modulus_seen and made.modulus != stated:
            suggest = f"modulus = {made.modulus}: a step over the end falls short by that, not {stated}"
            found.append(Suspicion(f"can.signals.{role}", "wrong_modulus", 0.99, suggest))
    return found


def wrong_scale(config: Config, role: str, one: Follower) -> Suspicion | None:
    """Return the suspicion that counts contradict teeth and radius, or a speed its unit; None if they
    agree.
    """
    wheel = WHEELS.index(role[-2:])
    radius = config.vehicle.wheel_radius_m[wheel]
    if one.series.kind == "count":
        per_metre = one.per_mps * abs(one.series.field.scale)
        teeth = config.vehicle.teeth(wheel)
        error = math.log(teeth / counts_per_revolution(per_metre, radius))
        probability = _probability_of_wrong_scale(error, SETTINGS.right_radius_std)
        fitting = round(counts_per_revolution(per_metre, radius))
        if probability < SETTINGS.decided or fitting == teeth:
            return None
        suggest = f"{fitting} counts per revolution go with a radius of {radius:g} m; {teeth:g} would need "
        suggest += f"{radius_from_counts_m(teeth, per_metre):.3f} m"
        return Suspicion("vehicle.teeth_per_rev", "wrong_teeth", probability, suggest)
    unit = canonical_unit(one.series.field.unit) or "km/h"
    mps = _mps_per(unit, radius)
    error = math.log(one.per_mps * abs(one.series.field.scale) * mps)
    probability = _probability_of_wrong_scale(error, SETTINGS.right_speed_std)
    if probability < SETTINGS.decided or abs(error) < SETTINGS.unit_fits:
        return None
    key = f"can.signals.{role}"
    seen = 1.0 / (one.per_mps * abs(one.series.field.scale))
    fitting_unit = _fitting_unit(config, role, seen, unit, radius)
    if fitting_unit is not None:
        suggest = f'unit = "{fitting_unit}": the receiver sees {seen / mps:.3f} times the speed'
        return Suspicion(key, "wrong_unit", probability, suggest)
    scale = one.series.field.scale * seen / mps
    suggest = f"scale = {scale:.6g}: the receiver sees {seen / mps:.3f} times the speed"
    return Suspicion(key, "wrong_scale", probability, suggest)


def _mps_per(unit: str, radius_m: float) -> float:
    """Return the road speed (m/s) that a reading of 1 in this unit stands for."""
    kind, factor, _ = UNITS[unit]
    return factor * (radius_m if kind == "angular speed" else 1.0)


def _fitting_unit(config: Config, role: str, seen_mps: float, unit: str, radius_m: float) -> str | None:
    """Return the unit in which a reading of 1 is `seen_mps`; None if there is none.

    Units of the stated kind come first: 1 rad/s on a small wheel is nearly 1 km/h. A file that states the
    scale and leaves the unit to the DBC is taken to be wrong in what it states.
    """
    option = config.can.option(role)
    if option.scale is not None and option.unit is None:
        return None
    kind = UNITS[unit][0]
    for other in sorted(_UNITS, key=lambda name: UNITS[name][0] != kind):
        if other != unit and abs(math.log(seen_mps / _mps_per(other, radius_m))) < SETTINGS.unit_fits:
            return other
    return None


def _probability_of_wrong_scale(error: float, std: float) -> float:
    """Return the probability that the scale is wrong, by the logarithm of its error."""
    right = norm.logpdf(error, 0.0, std)
    wrong = norm.logpdf(error, 0.0, SETTINGS.wrong_scale_std) if abs(error) < 0.3 else 0.0
    return min(0.999, float(1.0 / (1.0 + 9.0 * math.exp(min(right - wrong, 50.0)))))
