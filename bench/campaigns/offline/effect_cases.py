"""The effects of the catalogue as causes of `bench/worlds/causes.py`: sizes, conditions, and what is true.

In: an effect's name and a generator. Out: `Drawn`: the physics of its drive, what the drive must have so that
it can act at all, its parameters as the catalogue counts them, and which names beside it are true there.
Sizes are drawn about the catalogue's priors: between 0.7 and 2 standard deviations from none, or from the
mean where the mean is not none.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bench.campaigns.offline import effect_truth
from bench.campaigns.offline.effect_truth import Truth
from bench.worlds.motion import Course
from bench.worlds.spec import Spec

WHEELS = ("fl", "fr", "rl", "rr")


@dataclass(frozen=True)
class Drawn:
    """One effect of a drive."""

    physics: dict[str, dict[str, Any]]
    fixed: dict[str, Any] = field(default_factory=dict)
    """What the drive's specification must have."""
    truth: Truth = field(default_factory=dict)
    """By the catalogue's parameters."""
    fitted: Callable[[Course, Spec], Truth] | None = None
    """Parameters at which the catalogue's formula is nearest to what acts (least squares over the drive)."""
    wheels: tuple[str, ...] = ()
    """Where the effect acts on wheels that are looked for."""
    also: tuple[str, ...] = ()
    """Names beside it that are true."""
    limit: tuple[str, ...] = ()
    """What it is where it is small: no wrong name, and not the right one."""


def either(rng: np.random.Generator, std: float) -> float:
    """A size of either sign."""
    return float(rng.choice([-1.0, 1.0]) * std * rng.uniform(0.7, 2.0))


def above(rng: np.random.Generator, mean: float, std: float) -> float:
    """A positive size about a mean."""
    return float(max(mean + std * rng.uniform(-0.7, 1.5), 0.3 * mean))


def _wheel(rng: np.random.Generator) -> tuple[int, str]:
    k = int(rng.integers(4))
    return k, WHEELS[k]


def _axle(rng: np.random.Generator) -> tuple[list[int], tuple[str, ...]]:
    k = int(rng.integers(2))
    return [2 * k, 2 * k + 1], WHEELS[2 * k : 2 * k + 2]


def draw(effect: str, rng: np.random.Generator) -> Drawn:
    """Its cause with sizes; KeyError where there is none."""
    return CASES[effect](rng)


def _longitudinal_slip(rng: np.random.Generator) -> Drawn:
    c = above(rng, 4e-3, 2e-3)
    driven = str(rng.choice(["front", "rear"]))
    return Drawn(
        {"grip": {"stiffness": 1.0 / c, "most": 30.0}}, {"driven": driven}, fitted=effect_truth.linear_slip,
        wheels=WHEELS[:2] if driven == "front" else WHEELS[2:],
    )  # fmt: skip


def _drive_slip_curve(rng: np.random.Generator) -> Drawn:
    c, driven = above(rng, 4e-3, 2e-3), str(rng.choice(["front", "rear"]))
    return Drawn(
        {"grip": {"stiffness": 1.0 / c, "most": float(rng.uniform(2.2, 4.0))}},
        {"driven": driven, "road": "mixed"},
        fitted=effect_truth.grip,
        limit=("longitudinal_slip",),
        wheels=WHEELS[:2] if driven == "front" else WHEELS[2:],
    )


def _drive_split(rng: np.random.Generator) -> Drawn:
    c = above(rng, 3e-3, 1.5e-3)
    share = float(rng.choice([0.3, 0.65, 0.75]))
    return Drawn(
        {"axles": {"stiffness": 1.0 / c, "front_share": share}},
        {"driven": "all"},
        {"difference": 2.0 * c * (2.0 * share - 1.0)},
        also=("longitudinal_slip", "drive_slip_curve"),
    )


def _brake_slip(rng: np.random.Generator) -> Drawn:
    c, share = above(rng, 3e-3, 2e-3), float(rng.uniform(0.6, 0.75))
    return Drawn(
        {"brake_force": {"stiffness": 1.0 / c, "front_share": share, "most": 8.0}},
        truth={"front": c * share, "rear": c * (1.0 - share)},
    )


def _inner_wheel_slip(rng: np.random.Generator) -> Drawn:
    c, k, driven = above(rng, 4e-3, 2e-3), 0.08, str(rng.choice(["front", "rear"]))
    brakes = 0.5
    return Drawn(
        {"differential": {"stiffness": 1.0 / c, "load_per_lateral": k, "brake_share": brakes}},
        {"driven": driven},
        fitted=effect_truth.inner_wheels,
        # the force against drag, which is always there, shifts between the sides as their loads do
        also=("longitudinal_slip", "drive_slip_curve", "brake_slip", "load_transfer_lateral"),
    )


def _locked(rng: np.random.Generator) -> Drawn:
    share, driven = float(rng.uniform(0.25, 0.9)), str(rng.choice(["front", "rear"]))
    return Drawn(
        {"viscous": {"coupling": share / (1.0 - share)}},
        {"driven": driven},
        {"coefficient": share},
        wheels=WHEELS[:2] if driven == "front" else WHEELS[2:],
    )


def _rear_steering(rng: np.random.Generator) -> Drawn:
    share, straight = float(rng.uniform(0.07, 0.25)), float(rng.uniform(13.0, 18.0))
    truth = {"gain": share, "crossover_mps": straight}
    return Drawn({"rear_rack": {"share": share, "straight_mps": straight}}, {"road": "mixed"}, truth)


def _brake_drag(rng: np.random.Generator) -> Drawn:
    k, name = _wheel(rng)
    slip, cooling = float(rng.uniform(7e-4, 2.5e-3)), float(rng.uniform(120.0, 400.0))
    return Drawn(
        {"stuck_caliper": {"wheel": k, "slip": slip, "cooling_s": cooling, "m_per_slip": 0.5}},
        truth={"slip": slip},
        wheels=(name,),
    )


def _head_wind(rng: np.random.Generator) -> Drawn:
    size, towards = float(rng.uniform(7.0, 14.0)), float(rng.uniform(-math.pi, math.pi))
    wind = {"east_mps": size * math.cos(towards), "north_mps": size * math.sin(towards)}
    driven = str(rng.choice(["front", "rear"]))
    return Drawn({"airstream": {**wind, "stiffness": 250.0}}, {"driven": driven, "road": "motorway"}, wind)


def _brake_heat(rng: np.random.Generator) -> Drawn:
    wheels, names = _axle(rng)
    if rng.random() < 0.3:
        k, name = _wheel(rng)
        wheels, names = [k], (name,)
    growth, cooling = above(rng, 7e-7, 4e-7), float(rng.uniform(120.0, 400.0))
    return Drawn(
        {"brake_discs": {"per_energy": growth, "cooling_s": cooling, "wheels": wheels}},
        truth={"growth": growth, "cooling_s": cooling},
        wheels=names,
    )


def _sun_side(rng: np.random.Generator) -> Drawn:
    size, towards = 1e-4 * float(rng.uniform(1.0, 3.0)), float(rng.uniform(-math.pi, math.pi))
    east, north = math.cos(towards), math.sin(towards)
    return Drawn(
        {"sun": {"size_m": size, "east": east, "north": north, "lag_s": float(rng.uniform(240.0, 360.0))}},
        truth={"east_m": size * east, "north_m": size * north},
    )


def _ambient_pressure(rng: np.random.Generator) -> Drawn:
    per_pa = above(rng, 3.3e-8, 1.5e-8)
    passed = {"hilly": 0.02, "climb": 0.06, "road": "hills"}
    return Drawn({"barometer": {"m_per_pa": per_pa}}, passed, {"per_m": per_pa * 11.4}, also=("road_grade",))


def _camber_roll(rng: np.random.Generator) -> Drawn:
    lean, crown = math.radians(0.5), above(rng, 0.1, 0.1)
    return Drawn(
        {"camber": {"lean_rad_per_mps2": lean, "crown_m": crown}},
        truth={"coefficient": 0.5 * crown * lean**2},
    )


def _loads(rng: np.random.Generator, which: str, fitted: Callable[[Course, Spec], Truth]) -> Drawn:
    size = above(rng, 270.0, 180.0) if which == "n_per_lateral" else above(rng, 160.0, 110.0)
    return Drawn({"loads": {which: size, "softness": 1.0}}, fitted=fitted)


def _load_static(rng: np.random.Generator) -> Drawn:
    newton = float(rng.choice([-1.0, 1.0]) * rng.uniform(450.0, 1400.0))
    return Drawn(
        {"luggage": {"n_per_wheel": newton}}, {"stops": True, "road": "city"}, fitted=effect_truth.luggage
    )


def _radius_change(rng: np.random.Generator) -> Drawn:
    k, name = _wheel(rng)
    p = {"wheel": k, "lost": float(rng.uniform(0.15, 0.4)), "within_s": float(rng.uniform(5.0, 80.0))}
    onset = {"onset_s": float(rng.uniform(150.0, 400.0))}
    return Drawn({"leak": {**p, **onset}}, fitted=effect_truth.leak, wheels=(name,))


def _chains(rng: np.random.Generator) -> Drawn:
    driven = str(rng.choice(["front", "rear"]))
    wheels = [0, 1] if driven == "front" else [2, 3]
    names = tuple(WHEELS[k] for k in wheels)
    thick = float(rng.uniform(0.007, 0.012))
    span = {"onset_s": float(rng.uniform(120.0, 220.0)), "duration_s": float(rng.uniform(150.0, 300.0))}
    physics = {"chain_rings": {"wheels": wheels, "thick_m": thick, **span}}
    fixed = {"road": "city", "driven": driven}
    return Drawn(physics, fixed, span, effect_truth.chains, wheels=names)


def _wheel_lock(rng: np.random.Generator) -> Drawn:
    wheels, names = _axle(rng)
    span = {"onset_s": float(rng.uniform(150.0, 400.0)), "duration_s": float(rng.uniform(8.0, 30.0))}
    p = {"wheels": wheels, "slip": -float(rng.uniform(0.006, 0.05)), **span}
    return Drawn({"dragging_brake": p}, truth={"slip": p["slip"], **span}, wheels=names)


def _wheel_spin(rng: np.random.Generator) -> Drawn:
    driven = str(rng.choice(["front", "rear"]))
    wheels = [0, 1] if driven == "front" else [2, 3]
    span = {"onset_s": float(rng.uniform(150.0, 400.0)), "duration_s": float(rng.uniform(8.0, 40.0))}
    p = {"wheels": wheels, "slip": float(rng.uniform(0.005, 0.03)), **span}
    names = tuple(WHEELS[k] for k in wheels)
    return Drawn({"wheel_spin": p}, {"driven": driven}, {"slip": p["slip"], **span}, wheels=names)


def _pulses(rng: np.random.Generator, sign: float) -> Drawn:
    k, name = _wheel(rng)
    rate = float(rng.uniform(0.3, 1.5))
    fixed = {"wheel_signal": "counts", "teeth": float(rng.choice([44.0, 48.0, 60.0]))}
    return Drawn({"pulses": {"wheel": k, "per_s": sign * rate}}, fixed, {"rate_per_s": rate}, wheels=(name,))


def _tone_ring(rng: np.random.Generator) -> Drawn:
    k, name = _wheel(rng)
    off = either(rng, 4e-3)
    p = {"wheel": k, "eccentricity": abs(off), "phase_rad": float(rng.uniform(0.0, 6.0))}
    return Drawn({"eccentric_ring": p}, truth={"amplitude_rad": abs(off)}, wheels=(name,))


def _capture(rng: np.random.Generator) -> Drawn:
    per_mps = either(rng, 1e-4)
    short_s = per_mps * 2.0 * math.pi * 0.325 / 48.0
    fixed = {"wheel_signal": "speeds", "teeth": 48.0, "radius_m": 0.325, "road": "mixed"}
    return Drawn({"capture": {"short_s": short_s}}, fixed, {"per_mps": per_mps})


def _truncated(rng: np.random.Generator) -> Drawn:
    step = float(rng.choice([0.5, 1.0]))
    fixed = {"wheel_signal": "speeds", "speed_step_kmh": step, "road": "mixed"}
    return Drawn({"truncated": {}}, fixed, {"offset_mps": -0.5 * step / 3.6})


def _simple(cause: str, keys: dict[str, tuple[str, float]], **fixed: Any) -> Callable[..., Drawn]:
    """A cause whose values are the catalogue's: cause key -> (catalogue's parameter, standard deviation)."""

    def drawn(rng: np.random.Generator) -> Drawn:
        sizes = {key: either(rng, std) for key, (_, std) in keys.items()}
        truth = {name: sizes[key] for key, (name, _) in keys.items()}
        return Drawn({cause: sizes}, fixed, truth)

    return drawn


def _positive(cause: str, key: str, name: str, low: float, high: float, **fixed: Any) -> Callable[..., Drawn]:
    def drawn(rng: np.random.Generator) -> Drawn:
        size = float(rng.uniform(low, high))
        return Drawn({cause: {key: size}}, fixed, {name: size})

    return drawn


def _scaled(cause: str, key: str, name: str, std: float, **fixed: Any) -> Callable[..., Drawn]:
    def drawn(rng: np.random.Generator) -> Drawn:
        size = 1.0 + either(rng, std)
        return Drawn({cause: {key: size}}, fixed, {name: size})

    return drawn


def _cold_gyro(rng: np.random.Generator) -> Drawn:
    p = {"per_kelvin": either(rng, 3e-4), "fall_k": float(rng.uniform(8.0, 18.0))}
    return Drawn({"cold_gyro": p}, {"with_temperature": True, **GYRO}, {"per_kelvin": p["per_kelvin"]})


def _warming(rng: np.random.Generator) -> Drawn:
    tau = float(rng.uniform(1200.0, 2500.0))
    return Drawn(
        {"warming_gyro": {"size_radps": either(rng, 6e-6) * tau, "warming_s": tau}},
        GYRO,
        fitted=effect_truth.warming_gyro,
    )


GYRO: dict[str, Any] = {"with_gyro": True}
ACCEL: dict[str, Any] = {"with_accel": True, "with_gyro": True}
STEER: dict[str, Any] = {"with_steering": True, "with_gyro": True}
DOPPLER: dict[str, Any] = {"doppler_age_s": 0.0, "with_course": True, "receiver_hz": 5.0}
CASES: dict[str, Callable[[np.random.Generator], Drawn]] = {
    "accelerometer_bias": _simple(
        "zero_level", {"along_mps2": ("long_mps2", 0.4), "across_mps2": ("lat_mps2", 0.4)}, **ACCEL
    ),
    "accelerometer_tilt": lambda rng: Drawn(
        {"turned_mount": {"yaw_rad": (yaw := either(rng, 0.06)), "pitch_rad": 0.01, "roll_rad": -0.01}},
        ACCEL,
        {"yaw_rad": yaw},
    ),
    "ambient_pressure": _ambient_pressure,
    "antenna_lever_arm": _simple(
        "antenna_lever_arm", {"forward_m": ("forward_m", 0.6), "left_m": ("left_m", 0.2)}
    ),
    "brake_drag": _brake_drag,
    "brake_heat": _brake_heat,
    "brake_slip": _brake_slip,
    "camber_roll": _camber_roll,
    "centrifugal_growth": lambda rng: Drawn(
        {"belt": {"growth": above(rng, 1.2e-6, 7e-7)}}, fitted=effect_truth.belt
    ),
    "chains": _chains,
    "clock_drift": lambda rng: Drawn(
        {"crystal": {"rate": (rate := either(rng, 3e-4)), "bend_s": 2e-3}}, {}, {"rate": rate}
    ),
    "compliance_steer": lambda rng: Drawn(
        {"understeer": {"rad_per_mps2": (c := float(rng.uniform(5.5e-3, 9e-3)))}}, STEER, {"coefficient": c}
    ),
    "counter_extra_pulses": lambda rng: _pulses(rng, 1.0),
    "counter_lost_low_speed": lambda rng: Drawn(
        {},
        {
            "blind_below_mps": (below := float(rng.uniform(1.0, 2.5))),
            "stops": True,
            "road": "city",
            "wheel_signal": "counts",
        },
        {"below_mps": below},
    ),
    "counter_missed_pulses": lambda rng: _pulses(rng, -1.0),
    "doppler_heading_error": _simple(
        "moving_sky", {"east_mps": ("east_mps", 0.04), "north_mps": ("north_mps", 0.04)}, **DOPPLER
    ),
    "drive_slip_curve": _drive_slip_curve,
    "drive_split": _drive_split,
    "gnss_latency": _positive("gnss_latency", "latency_s", "latency_s", 0.08, 0.3),
    "gnss_smoothing": _positive("velocity_filter", "tau_s", "time_constant_s", 0.3, 1.2, **DOPPLER),
    "gyro_drift": _warming,
    "gyro_misalignment": lambda rng: Drawn(
        {"leaning_gyro": {"sideways_rad": (lean := either(rng, 0.04)), "forward_rad": 0.01}},
        {"hilly": 0.05, "road": "hills", **GYRO},
        {"sideways_rad": lean},
        also=("road_grade",),
    ),
    "gyro_temperature": _cold_gyro,
    "head_wind": _head_wind,
    "inner_wheel_slip": _inner_wheel_slip,
    "lateral_slip": lambda rng: Drawn(
        {"lateral_slip": {"coefficient": (c := above(rng, 5e-3, 3e-3))}}, {}, {"coefficient": c}
    ),
    "load_static": _load_static,
    "load_transfer_lateral": lambda rng: _loads(rng, "n_per_lateral", effect_truth.load_lateral),
    "load_transfer_longitudinal": lambda rng: _loads(rng, "n_per_long", effect_truth.load_long),
    "locked_differential": _locked,
    "longitudinal_slip": _longitudinal_slip,
    "message_delay": _simple("axle_messages", {"late_s": ("front_s", 0.012)}, with_accel=True),
    "radius_change": _radius_change,
    "rear_axle_steering": _rear_steering,
    "road_bank": _positive("banked_bends", "share", "bank_share", 0.18, 0.4, **ACCEL),
    "road_grade": lambda rng: Drawn({}, {"hilly": 0.05, "road": "hills"}),
    "speed_rounding_offset": _truncated,
    "speed_scale_nonlinearity": _capture,
    "steering_offset": _simple("column", {"off_rad": ("offset_rad", 0.06)}, **STEER),
    "steering_ratio_error": lambda rng: replace(
        _scaled("rack", "ratio", "ratio", 0.12, **STEER)(rng), fitted=effect_truth.rack
    ),
    "sun_side": _sun_side,
    "thermal_growth": lambda rng: Drawn(
        {
            "rolling_heat": {
                "size_m": above(rng, 1e-3, 4e-4),
                "time_constant_s": float(rng.uniform(250.0, 600.0)),
            }
        },
        fitted=effect_truth.rolling_heat,
    ),
    "tone_ring_error": _tone_ring,
    "track_width_error": _simple(
        "track_width_error", {"rear_m": ("rear_m", 0.04), "front_m": ("front_m", 0.04)}
    ),
    "velocity_lag": _positive("late_doppler", "late_s", "lag_s", 0.12, 0.3, **DOPPLER),
    "wheel_lock": _wheel_lock,
    "wheel_spin": _wheel_spin,
    "wheel_speed_filter": _positive("dashboard", "tau_s", "time_constant_s", 0.2, 0.6, wheel_signal="speeds"),
    "yaw_rate_bias": _simple("yaw_rate_bias", {"bias": ("bias", 3e-3)}, **GYRO),
    "yaw_rate_scale": _scaled("yaw_rate_scale", "scale", "scale", 0.025, **GYRO),
}
"""By the catalogue's names. Not here: `spare_or_mixed_tyre`, which calibration takes up, `wear`, which acts
between drives, and `torque_slip`, for no world of these tells a torque."""
