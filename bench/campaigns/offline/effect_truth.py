"""What a cause of `bench/worlds/causes.py` is by the catalogue's formula.

In: course and specification of a drive. Out: the parameters of the catalogue nearest to what acts, by least
squares over the driving, where a cause has no parameter of that meaning.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from bench.worlds.causes import FRONT, LEFT, gyro_error, pull, radius_change, slip, steering_wheel
from bench.worlds.instruments import STEERING_RATIO
from bench.worlds.motion import Array, Course
from bench.worlds.spec import Spec

Truth = dict[str, float]


def _nearest(
    start: list[float], names: tuple[str, ...], formula: Callable[..., Array], whole: Array
) -> Truth:
    """Values of a formula (n, ...) nearest to `whole`; a constant per column is calibration.

    They are positive, and within a factor of twenty of `start`."""
    scale = np.array(start)

    def left(x: Array) -> Array:
        off = (whole - formula(*(x * scale))).reshape(len(whole), -1)
        return np.asarray((off - off.mean(axis=0)).ravel() / max(float(np.std(whole)), 1e-12))

    found = least_squares(left, np.ones(len(start)), bounds=(0.05, 20.0)).x * scale
    return dict(zip(names, found.tolist(), strict=True))


def _driving(course: Course) -> np.ndarray:
    return np.asarray(course.speed > 5.0)


def rolling_heat(course: Course, spec: Spec) -> Truth:
    """Exponential warm-up nearest to that by way and wind."""
    on = _driving(course)
    t, whole = course.time_s[on], radius_change(course, spec)[on, 0]
    p = spec.physics["rolling_heat"]
    names = ("amplitude_m", "time_constant_s")
    return _nearest(
        [p["size_m"], p["time_constant_s"]], names, lambda a, tau: a * (1.0 - np.exp(-t / tau)), whole
    )


def grip(course: Course, spec: Spec) -> Truth:
    """Dugoff's curve nearest to the tyre's."""
    on = _driving(course)
    p = spec.physics["grip"]
    axle = 0 if spec.driven == "front" else 2
    whole, a_x, v = slip(course, spec)[on, axle], course.force[on], course.speed[on]

    def dugoff(c: float, d: float, most: float) -> Array:
        share = np.clip(a_x / most, -0.9, 0.9)
        bent = np.sign(share) / (4.0 * (1.0 - np.abs(share)))
        return np.asarray(c * most * np.where(np.abs(share) < 0.5, share, bent) + d * v**2)

    start = [1.0 / p["stiffness"], 2.7e-4 / p["stiffness"], p["most"]]
    return _nearest(start, ("slip_per_accel", "slip_per_speed2", "saturation_mps2"), dugoff, whole)


def linear_slip(course: Course, spec: Spec) -> Truth:
    """Slip in proportion to force and speed squared nearest to the tyre's."""
    on = _driving(course)
    p = spec.physics["grip"]
    axle = 0 if spec.driven in ("front", "all") else 2
    whole, a_x, v = slip(course, spec)[on, axle], course.force[on], course.speed[on]
    start = [1.0 / p["stiffness"], 2.7e-4 / p["stiffness"]]
    names = ("slip_per_accel", "slip_per_speed2")
    return _nearest(start, names, lambda c, d: c * a_x + d * v**2, whole)


def load_lateral(course: Course, spec: Spec) -> Truth:
    """Radius per lateral acceleration nearest to the tyre's under its loads."""
    on = _driving(course)
    whole, a_lat = radius_change(course, spec)[on], course.a_lat[on, None] * LEFT
    return _nearest([1e-4], ("coefficient",), lambda c: c * a_lat, whole)


def load_long(course: Course, spec: Spec) -> Truth:
    """Radius per specific force nearest to the tyre's under its loads."""
    on = _driving(course)
    whole, a_x = radius_change(course, spec)[on], course.force[on, None] * np.where(FRONT, 1.0, -1.0)
    return _nearest([1e-4], ("coefficient",), lambda c: c * a_x, whole)


def belt(course: Course, spec: Spec) -> Truth:
    """Growth with the speed squared nearest to the belt's."""
    on = _driving(course)
    v = course.speed[on]
    return _nearest([1e-6], ("coefficient",), lambda k: k * v**2, radius_change(course, spec)[on, 0])


def inner_wheels(course: Course, spec: Spec) -> Truth:
    """Difference of slips per force and lateral acceleration nearest to that of tyres by what they carry."""
    on = _driving(course)
    force, product = pull(course)[on], (pull(course) * course.a_lat)[on]
    half = 0.5 * (slip(course, spec)[on][:, ::2] - slip(course, spec)[on][:, 1::2])
    drives = 1 if spec.driven == "rear" else 0
    out = {}
    for name, axle, acts in (
        *(("driven", drives, force > 0.0), ("braked", drives, force < 0.0)),
        ("free", 1 - drives, force < 0.0),
    ):
        out[name] = float(half[acts, axle] @ product[acts] / (product[acts] @ product[acts]))
    return out


def rack(course: Course, spec: Spec) -> Truth:
    """Ratio nearest to that of a rack which is quicker towards the lock."""
    on = _driving(course)
    bare = replace(spec, physics={})
    shown, expected = (steering_wheel(course, one, STEERING_RATIO)[on] for one in (spec, bare))
    return {"ratio": float(shown @ expected / (expected @ expected))}


def luggage(course: Course, spec: Spec) -> Truth:
    """Change of the rear radii."""
    return {"rear_m": float(radius_change(course, spec)[-1, 2])}


def leak(course: Course, spec: Spec) -> Truth:
    """Final change of the radius."""
    return {"deviation_m": float(radius_change(course, spec)[-1, spec.physics["leak"]["wheel"]])}


def warming_gyro(course: Course, spec: Spec) -> Truth:
    """Slope of the line through the gyro's zero."""
    return {"rate": float(np.polyfit(course.time_s, gyro_error(course, spec), 1)[0])}


def chains(course: Course, spec: Spec) -> Truth:
    """What the rings make of the wheels' turning."""
    thick = spec.physics["chain_rings"]["thick_m"]
    return {"slip": -thick / (spec.radius_m + thick)}
