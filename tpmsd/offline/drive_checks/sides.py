"""Sides, axles and antenna: where the wheels and the receiver are on the car.

In: a configuration, wheel signals placed by the drive. Out: suspicions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from scipy.stats import norm

from tpmsd.car.config.model import Config
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.discovery.assign import Assignment, Role
from tpmsd.offline.discovery.geometry import CarGeometry, driven_axle
from tpmsd.offline.discovery.prepared_log import PreparedLog
from tpmsd.offline.discovery.series import Series
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.offline.discovery.wheels import Follower
from tpmsd.offline.drive_checks.signs import wrong_signs
from tpmsd.offline.drive_checks.suspicion import Suspicion


def wrong_sides(by_wheel: dict[str, str], by_position: dict[str, Follower]) -> list[Suspicion]:
    """Return a suspicion for each axle whose left and right are exchanged, by the sign of the track."""
    found = []
    for left, right in (("fl", "fr"), ("rl", "rr")):
        if left not in by_position or right not in by_position:
            continue
        one, other = by_position[left], by_position[right]
        std = math.hypot(one.lateral_std_m, other.lateral_std_m, 0.15)
        span = one.lateral_m - other.lateral_m
        track, spread = SETTINGS.track_m, math.hypot(std, 0.15)
        if not math.isfinite(span / std):
            continue
        probability = _probability_of_opposite_sign(span, track, spread)
        if probability >= SETTINGS.decided:
            names = f"{one.series.field.signal} is on the right and {other.series.field.signal} on the left"
            found.append(Suspicion(f"can.signals.{by_wheel[left]}", "swapped_left_right", probability, names))
    return found


def car_suspicions(
    config: Config,
    by_wheel: dict[str, str],
    by_position: dict[str, Follower],
    read: Mapping[str, Series],
    material: PreparedLog,
    settings: Settings,
) -> list[Suspicion]:
    """Return the suspicions about axles, driven axle, antenna and signs; both rear wheels are read."""
    four = len(by_position) == 4
    wheels = WHEELS if four else ("rl", "rr")
    kind = "counts" if by_position["rl"].series.kind == "count" else "speeds"
    swapped_sides = by_position["rl"].lateral_m < by_position["rr"].lateral_m
    order = {w: (w[0] + ("r" if w[1] == "l" else "l") if swapped_sides else w) for w in wheels}
    roles = tuple(Role(w, by_position[order[w]], 1.0, ()) for w in wheels)
    assignment = Assignment(kind, roles, not four, 1.0, 1.0)
    geometry = CarGeometry(assignment, material.reference, material.gyro, settings)
    found = _exchanged_axles(config, by_wheel, geometry) if four else []
    turned = bool(found)
    found += _wrong_driven_axle(config, driven_axle(assignment), turned)
    if not turned:
        found += wrong_antenna(config, geometry)
    return found + wrong_signs(config, read, material.reference, geometry.motion()[0])


def _exchanged_axles(config: Config, by_wheel: dict[str, str], geometry: CarGeometry) -> list[Suspicion]:
    """Return the suspicion that front and rear are exchanged, by the sign of the squared wheelbase; empty
    without one.
    """
    if geometry.square_m2 is None:
        return []
    square, std = geometry.square_m2.value, math.hypot(geometry.square_m2.std, 0.5)
    aim, spread = config.vehicle.wheelbase_m**2, math.hypot(std, 0.3 * config.vehicle.wheelbase_m)
    probability = _probability_of_opposite_sign(square, aim, spread)
    if probability < SETTINGS.decided:
        return []
    suggest = "in bends the wheels called rear have the longer way: exchange front and rear"
    return [Suspicion(f"can.signals.{by_wheel['fl']}", "swapped_front_rear", probability, suggest)]


def _wrong_driven_axle(config: Config, axle: tuple[str, float] | None, turned: bool) -> list[Suspicion]:
    """Return the suspicion that the other axle is driven, empty without one; `turned`: front and rear are
    exchanged.
    """
    if axle is None or config.vehicle.driven_axle not in ("front", "rear"):
        return []
    name, probability = axle
    if turned:
        name = "rear" if name == "front" else "front"
    if name == config.vehicle.driven_axle or probability < 0.99:
        return []
    suggest = f'driven_axle = "{name}": its wheels turn faster under acceleration'
    return [Suspicion("vehicle.driven_axle", "wrong_driven_axle", probability, suggest)]


def _probability_of_opposite_sign(seen: float, right: float, spread: float) -> float:
    """Return the probability that the value is minus the right one, with a prior of one file in fifty."""
    ratio = norm.logpdf(seen, -right, spread) - norm.logpdf(seen, right, spread) + math.log(0.02)
    return min(0.999, float(1.0 / (1.0 + math.exp(-min(max(ratio, -50.0), 50.0)))))


def wrong_antenna(config: Config, geometry: CarGeometry) -> list[Suspicion]:
    """Return a suspicion for each coordinate of the antenna that the drive contradicts."""
    found = []
    floors = {
        "antenna_left_m": SETTINGS.antenna_left_floor_m,
        "antenna_forward_m": SETTINGS.antenna_forward_floor_m,
    }
    for key, floor in floors.items():
        antenna = geometry.gnss.get(key)
        if antenna is None:
            continue
        stated = float(getattr(config.gnss, key))
        z = abs(antenna.value - stated) / math.hypot(antenna.std, floor)
        probability = min(0.999, float(1.0 - 2 * norm.sf(z)))
        if z > SETTINGS.antenna_z:
            suggest = f"{key} = {antenna.value:.2f} (+- {antenna.std:.2f})"
            found.append(Suspicion(f"gnss.{key}", "wrong_antenna", probability, suggest))
    return found
