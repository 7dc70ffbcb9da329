"""Signs and sizes of yaw rate, accelerations and steering wheel against the car's motion.

In: signals as a configuration reads them, the receiver's motion. Out: suspicions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.stats import norm

from tpmsd.car.config.model import Config
from tpmsd.car.config.units import allowed_units, to_si
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.other_roles import physical, smooth
from tpmsd.offline.discovery.reference import ReceiverMotion
from tpmsd.offline.discovery.series import Series
from tpmsd.offline.discovery.settings import SETTINGS
from tpmsd.offline.drive_checks.suspicion import Suspicion


def wrong_signs(
    config: Config, read: Mapping[str, Series], reference: ReceiverMotion, speed: FloatArray
) -> list[Suspicion]:
    """Return the suspicions of wrong signs and sizes of the other roles, against the car's motion by receiver
    and wheels.
    """
    accel = np.full(len(speed), np.nan)
    accel[1:-1] = (speed[2:] - speed[:-2]) / (2 * SETTINGS.cell_s)
    steering = config.vehicle.wheelbase_m * (config.vehicle.steering_ratio or math.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = {
            "yaw_rate": reference.yaw_radps,
            "accel_lat": reference.yaw_radps * speed,
            "accel_long": accel,
            "steering_wheel_angle": np.where(speed > 3.0, reference.yaw_radps / speed, np.nan),
        }
    found = []
    for role, aim_of_role in expected.items():
        one = read.get(role)
        if one is None:
            continue
        option, unit = config.can.option(role), one.field.unit
        factor, _ = to_si(role, unit)
        value = smooth(option.sign * factor * physical(one))
        aim = smooth(aim_of_role)
        rows = np.isfinite(value) & np.isfinite(aim) & (speed > 3.0)
        if rows.sum() < 60 or not np.ptp(value[rows]) > 0:
            continue
        r = float(np.corrcoef(value[rows], aim[rows])[0, 1])
        # Fisher's z with as many independent readings as smoothing leaves.
        z = math.atanh(max(min(r, 0.999), -0.999)) * math.sqrt(max(rows.sum() / 15.0 - 3.0, 1.0))
        probability = min(0.999, float(norm.cdf(abs(z))))
        key = f"can.signals.{role}"
        if r < -0.4 and z < -3.0:
            turned = -1 if option.sign > 0 else 1
            suggest = f"sign = {turned}: it runs against the car's motion (correlation {r:.2f})"
            found.append(Suspicion(key, "wrong_sign", probability, suggest))
        if abs(z) < 3.0:
            continue
        gain, apart = float(np.std(value[rows]) / np.std(aim[rows])), SETTINGS.sensors_apart
        if role == "steering_wheel_angle":
            gain, apart = gain / steering, SETTINGS.steering_apart
        # Where either side errs, the true gain lies between the two regressions' (Frisch 1934).
        if gain * abs(r) > apart or gain / abs(r) < 1.0 / apart:
            found.append(_size_suspicion(role, key, unit, gain, probability))
    return found


def _size_suspicion(role: str, key: str, unit: str, gain: float, probability: float) -> Suspicion:
    """Return the suspicion about a signal that is `gain` times the right value: another unit of the role, or
    another scale.
    """
    factor, _ = to_si(role, unit)
    others = {other: to_si(role, other)[0] for other in allowed_units(role)}
    fitting = min(others, key=lambda other: abs(math.log(others[other] * gain / factor)))
    seen = f"it is {gain:.3g} times what the car's motion tells"
    if others[fitting] != factor and abs(math.log(others[fitting] * gain / factor)) < SETTINGS.unit_near:
        return Suspicion(key, "wrong_unit", probability, f'unit = "{fitting}": {seen}')
    return Suspicion(key, "wrong_scale", probability, seen)
