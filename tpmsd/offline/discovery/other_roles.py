"""The optional signals: gyro, accelerometers, steering, brake, torque, temperature.

In: series of a DBC's signals, what the wheels and the receiver say of the motion. Out: `FoundRole`s.

Each role has an expectation (yaw rate, v r, dv/dt, r/v, ...), a kind of unit, and words in names. A
signal's likelihood
is that of its residual to the expectation, its scale free; unit and name are evidence beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tpmsd.car.config.units import UNITS, assumed_unit, canonical_unit, role_kinds, to_si
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.names import role_evidence
from tpmsd.offline.discovery.reference import ReceiverMotion
from tpmsd.offline.discovery.result import FoundRole
from tpmsd.offline.discovery.series import Series
from tpmsd.offline.discovery.settings import SETTINGS, Settings

_MIN_R = {
    "yaw_rate": 0.7, "accel_long": 0.6, "accel_lat": 0.7, "steering_wheel_angle": 0.7, "brake_pressure": 0.5,
    "drive_torque": 0.4,
}  # fmt: skip
"""Correlation with the expectation below which a signal plays no role."""


def smooth(value: FloatArray, cells: int = SETTINGS.smooth_cells) -> FloatArray:
    """Return the running mean (n,) of n values, zeros beyond their ends; NaN where a cell is unknown."""
    if not len(value):
        return value
    first = (cells - 1) // 2
    return np.asarray(np.convolve(value, np.ones(cells) / cells)[first : first + len(value)])


def physical(one: Series) -> FloatArray:
    """Return the physical value by the DBC."""
    return one.rate * one.field.scale + one.field.offset


def find_gyro(
    series: Sequence[Series], reference: ReceiverMotion, settings: Settings = SETTINGS
) -> FloatArray | None:
    """Return a yaw rate in rad/s by a signal that agrees with the receiver's course; None if there is
    none."""
    best: tuple[float, FloatArray] | None = None
    course = smooth(reference.yaw_radps)
    for one in series:
        if one.kind != "value" or _unit_fits_role(one.field.unit, "yaw_rate") is not True:
            continue
        factor, _ = to_si("yaw_rate", one.field.unit)
        value = physical(one) * factor
        slow = smooth(value)  # unknown beside cells that are
        rows = reference.moving & np.isfinite(slow) & np.isfinite(course)
        if rows.sum() < 40 or not np.ptp(value[rows]) > 0:
            continue
        r = float(np.corrcoef(slow[rows], course[rows])[0, 1])
        if abs(r) < 0.4 or (best is not None and abs(r) <= best[0]):
            continue
        slope = float(np.std(value[rows])) / max(float(np.std(course[rows])), 1e-9)
        if not 0.4 < slope < 2.0:
            continue
        bias = float(np.median(math.copysign(1.0, r) * value[rows] - course[rows]))
        best = abs(r), math.copysign(1.0, r) * value - bias
    return None if best is None else best[1]


def other_roles(
    series: Sequence[Series],
    reference: ReceiverMotion,
    speed: FloatArray,
    yaw: FloatArray,
    taken: set[str],
    settings: Settings = SETTINGS,
) -> dict[str, FoundRole]:
    """Return roles with a probability of at least a half; `speed` and `yaw` by the wheels."""
    accel = np.full(len(speed), np.nan)
    accel[1:-1] = (speed[2:] - speed[:-2]) / (2 * settings.cell_s)
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = np.where(speed > 3.0, yaw / speed, np.nan)
    expected = {
        "yaw_rate": yaw,
        "accel_lat": yaw * speed,
        "accel_long": accel,
        "steering_wheel_angle": curvature,
        "brake_pressure": np.maximum(-accel - 0.5, 0.0),
        "drive_torque": accel,
    }
    found: dict[str, FoundRole] = {}
    for role, target in expected.items():
        ranked = _best_series(series, role, target, speed, taken)
        if ranked:
            found[role] = ranked
            taken = taken | {ranked.field.signal}
    ambient = _find_ambient_temperature(series, taken)
    if ambient is not None:
        found["ambient_temp"] = ambient
    return found


def _unit_fits_role(unit: str, role: str) -> bool | None:
    """Return whether a unit is one that the role can have; None for an unknown unit."""
    known = canonical_unit(unit)
    if known is None:
        return None
    try:
        to_si(role, unit)
    except ConfigError:
        return False
    return UNITS[known][0] in role_kinds(role)


def _best_series(
    series: Sequence[Series], role: str, target: FloatArray, speed: FloatArray, taken: set[str]
) -> FoundRole | None:
    """Return the signal that fits a role best, its probability and alternatives; None where none fits."""
    moving = np.isfinite(target) & (speed > 2.0)
    aim = smooth(target)
    free = [one for one in series if one.kind == "value" and one.field.signal not in taken]
    judged = ((one, _role_evidence(one, role, aim, moving)) for one in free)
    scored = [(*score, one) for one, score in judged if score is not None]
    if not scored:
        return None
    scored.sort(key=lambda entry: -entry[0])
    weight = np.exp(np.array([entry[0] for entry in scored]) - scored[0][0])
    # The alternative that is always there: none of these.
    share = weight / (weight.sum() + math.exp(-min(scored[0][0], 50.0)))
    _, r, one = scored[0]
    alternatives = tuple(
        (entry[2].field.signal, float(p))
        for entry, p in zip(scored[1:4], share[1:4], strict=True)
        if p > 1e-3
    )
    sign = -1.0 if r < 0 and role in ("yaw_rate", "accel_lat", "accel_long", "steering_wheel_angle") else 1.0
    if r < 0 and sign > 0:
        return None
    unit = None if _unit_fits_role(one.field.unit, role) else assumed_unit(role)
    return FoundRole(role, one.field, min(float(share[0]), 0.999), alternatives, unit=unit, sign=sign)


def _role_evidence(one: Series, role: str, aim: FloatArray, moving: np.ndarray) -> tuple[float, float] | None:
    """Return the evidence (nats) for a signal in a role and its correlation with the target `aim`.

    None where neither unit nor name fits, or the signal does not follow the role's target.
    """
    fits = _unit_fits_role(one.field.unit, role)
    word = role_evidence(one.field.signal, role)
    if fits is False or (fits is None and word == 0.0):  # a correlation alone names nothing
        return None
    value = smooth(physical(one))
    rows = moving & np.isfinite(value) & np.isfinite(aim)
    if rows.sum() < 40 or not np.ptp(value[rows]) > 0:
        return None
    r = float(np.corrcoef(value[rows], aim[rows])[0, 1])
    if not abs(r) >= _MIN_R[role]:
        return None
    effective = min(rows.sum() / (2 * SETTINGS.smooth_cells), 100.0)
    evidence = (
        -0.5 * effective * math.log(max(1 - r * r, 1e-4)) + word + (SETTINGS.unit_nats if fits else 0.0)
    )
    if role == "steering_wheel_angle" and fits:
        evidence += _steering_scale(one, value, aim, rows)
    return evidence, r


def _steering_scale(one: Series, value: FloatArray, curvature: FloatArray, rows: np.ndarray) -> float:
    """Return the evidence (nats) for a steering-wheel angle by its ratio to the curvature; that of a
    road-wheel angle or a torque is wrong."""
    factor, _ = to_si("steering_wheel_angle", one.field.unit)
    ratio = (
        float(np.std(value[rows])) * factor / max(float(np.std(curvature[rows])), 1e-9) / SETTINGS.wheelbase_m
    )
    return 0.0 if SETTINGS.steering_ratios[0] < ratio < SETTINGS.steering_ratios[1] else -6.0


def _find_ambient_temperature(series: Sequence[Series], taken: set[str]) -> FoundRole | None:
    """Return the signal of an ambient temperature, which hardly changes, is one of weather, and is called so;
    None if there is none."""
    ranked = []
    for one in series:
        if one.kind != "value" or one.field.signal in taken:
            continue
        if _unit_fits_role(one.field.unit, "ambient_temp") is not True:
            continue
        value = physical(one)
        known = value[np.isfinite(value)]
        if len(known) < 4:
            continue
        factor, offset = to_si("ambient_temp", one.field.unit)
        celsius = factor * known + offset - 273.15
        if (
            not (SETTINGS.ambient_c[0] < celsius.min() and celsius.max() < SETTINGS.ambient_c[1])
            or np.ptp(celsius) > 12.0
        ):
            continue
        ranked.append((role_evidence(one.field.signal, "ambient_temp"), one))
    if not ranked:
        return None
    ranked.sort(key=lambda entry: -entry[0])
    weight = np.exp(np.array([entry[0] for entry in ranked]))
    share = weight / (weight.sum() + 1.0)  # an inlet, a cabin, a battery at rest is as warm
    if share[0] < 0.5:
        return None
    alternatives = tuple((e[1].field.signal, float(p)) for e, p in zip(ranked[1:4], share[1:4], strict=True))
    return FoundRole("ambient_temp", ranked[0][1].field, float(share[0]), alternatives)
