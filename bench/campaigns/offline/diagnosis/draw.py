"""Which drive is made for a kind, a strength and a seed.

In: those three. Out: `Case`: the specification of car, road, receiver and bus, and the concealed physics.
Strength 1 is the size of a 20 % pressure loss, or what disturbs a diagnosis as much. Kinds:

    nothing, nothing_wander            no physics missing; the latter with radius drift as in real cars
    EFFECT, EFFECT+EFFECT, ...         of the public table, with the name withheld
    strange_...                        by no formula of the catalogue, most by no cause of it either
    absorbed:EFFECT                    configured radii far off, so that calibration takes up the mean
    habit:EFFECT                       a driver who goes faster and faster
    cancel:growth_slip|track_load|arm_slip   two effects that cancel over most of the drive
    small:EFFECT                       an eighth of the strength: in no single window to be seen
    leak_behind_warmup                 a wheel loses what the warm-up gives
    warmup_like_leak                   warm-up alone, slow and nearly a ramp, or cooling down

The name of an origin in front of a kind (`traffic/gnss_latency`; `mb/` for `multibody/`) takes its drive from
there: see `bench/worlds/origins.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bench.worlds.origins import ORIGINS
from bench.worlds.spec import Spec

LOSS = 0.0046
"""Relative change of radius of a 20 % pressure loss: strength 1."""
WHEELS = ("fl", "fr", "rl", "rr")
EFFECTS = (
    *("centrifugal_growth", "thermal_growth", "load_transfer_longitudinal", "load_transfer_lateral"),
    *("longitudinal_slip", "lateral_slip", "road_grade", "gnss_latency", "antenna_lever_arm"),
    *("track_width_error", "yaw_rate_bias", "yaw_rate_scale", "tone_ring_error", "radius_change"),
)
STRANGE = (
    *("strange_speed_hump", "strange_camber", "strange_span", "strange_effort", "strange_brake_heat"),
    *("strange_gyro_warming", "strange_gyro_square", "strange_heading_glitch", "strange_doppler_bend"),
)
TOGETHER = (
    "centrifugal_growth+thermal_growth",
    "longitudinal_slip+gnss_latency",
    "radius_change+thermal_growth",
    "load_transfer_lateral+track_width_error",
    "lateral_slip+antenna_lever_arm",
    "radius_change+load_transfer_longitudinal+yaw_rate_bias",
    "centrifugal_growth+longitudinal_slip+gnss_latency",
)
CONCEALED = (
    *("absorbed:centrifugal_growth", "absorbed:radius_change", "absorbed:thermal_growth"),
    *("cancel:growth_slip", "cancel:track_load", "cancel:arm_slip"),
    *("small:load_transfer_lateral", "small:longitudinal_slip", "small:radius_change"),
    *("habit:centrifugal_growth", "habit:thermal_growth", "habit:radius_change"),
    *("leak_behind_warmup", "warmup_like_leak"),
)
MULTIBODY = (
    *("mb/nothing", "mb/centrifugal_growth", "mb/thermal_growth", "mb/radius_change", "mb/gnss_latency"),
    *("mb/antenna_lever_arm", "mb/load_transfer_lateral", "mb/yaw_rate_bias", "mb/tone_ring_error"),
    "mb/radius_change+thermal_growth",
)


@dataclass(frozen=True)
class Case:
    """One drive to be made."""

    kind: str
    strength: float
    seed: int
    spec: Spec
    world_seed: int
    world: str = "kinematic"
    wanted: tuple[str, ...] = field(default=())
    """Keys of the concealed physics that a diagnosis should find."""

    @property
    def key(self) -> str:
        """What tells one case from all others."""
        return f"{self.kind} {self.strength:g} {self.seed}"


def draw_case(kind: str, strength: float, seed: int) -> Case:
    """Draw it; ValueError for a kind that is not known."""
    rng = np.random.default_rng([seed, sum(map(ord, kind)), round(100 * strength)])
    prefix, _, plain = kind.rpartition("/")
    world = {"": "kinematic", "mb": "multibody"}.get(prefix, prefix)
    if world not in ORIGINS:
        raise ValueError(f"{kind}: no such origin: {world}")
    fixed: dict[str, Any] = {}
    if "road_grade" in plain:
        fixed = {"hilly": 0.03 * strength, "road": "hills"}
    if plain.startswith("habit:"):
        fixed = {"rising_speed": True, "road": "mixed", "stops": False}
    spec = ORIGINS[world].spec(rng, **fixed)
    if plain.startswith("absorbed:"):
        spec = replace(
            spec, radius_off=float(rng.choice([-1, 1]) * rng.uniform(0.01, 0.03)), radius_spread_m=1.2e-3
        )
    if plain == "nothing_wander":
        spec = replace(spec, radius_drift=float(rng.uniform(2e-4, 5e-4)))
    if "thermal" in plain or "warmup" in plain:
        spec = replace(spec, duration_s=float(rng.uniform(900, 1200)))
    if world == "multibody":
        spec = replace(spec, duration_s=min(spec.duration_s, 900.0))
    spec.physics.update(_physics(plain, strength, spec, rng))
    wanted = tuple(name for name in spec.physics if name != "no_shortening")
    return Case(
        kind=kind,
        strength=strength,
        seed=seed,
        spec=spec,
        world_seed=int(rng.integers(2**31)),
        world=world,
        wanted=wanted,
    )


def _physics(kind: str, strength: float, spec: Spec, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    if kind in ("nothing", "nothing_wander"):
        return {}
    how, _, what = kind.rpartition(":")
    if how == "small":
        strength = strength / 8
    if how == "cancel":
        return _cancelling(what, strength, spec, rng)
    if kind == "leak_behind_warmup":
        return _leak_behind_warmup(strength, spec, rng)
    if kind == "warmup_like_leak":
        sign = -1.0 if rng.random() < 0.25 else 1.0
        size = sign * strength * LOSS * spec.radius_m
        return {
            "thermal_growth": {"amplitude_m": 1.5 * size, "time_constant_s": float(rng.uniform(1000, 1800))}
        }
    out: dict[str, dict[str, Any]] = {}
    for effect in what.split("+"):
        if effect not in EFFECTS and effect not in STRANGE:
            raise ValueError(f"{kind}: {effect} is no kind that is known")
        out[effect] = concealed(effect, strength, spec, rng)
    return out


def concealed(effect: str, strength: float, spec: Spec, rng: np.random.Generator) -> dict[str, Any]:
    """An effect's parameters at a strength."""
    size = strength * LOSS * spec.radius_m
    end = spec.duration_s
    wheel = str(rng.choice(WHEELS))
    sign = float(rng.choice([-1.0, 1.0]))
    along = strength * LOSS / 2
    table: dict[str, dict[str, Any]] = {
        "centrifugal_growth": {"coefficient": size / 900},
        "thermal_growth": {"amplitude_m": size, "time_constant_s": float(rng.uniform(250, 700))},
        "load_transfer_longitudinal": {"coefficient": size / 2},
        "load_transfer_lateral": {"coefficient": size / 2},
        "longitudinal_slip": {"slip_per_accel": along, "slip_per_speed2": along * 2.7e-4},
        "lateral_slip": {"coefficient": strength * LOSS},
        "road_grade": {},
        "gnss_latency": {"latency_s": strength * 0.08},
        "antenna_lever_arm": {"forward_m": strength * 0.8, "left_m": strength * 0.3 * sign},
        "track_width_error": {"rear_m": strength * 0.03 * sign, "front_m": -strength * 0.02 * sign},
        "yaw_rate_bias": {"bias": strength * 1e-3 * sign},
        "yaw_rate_scale": {"scale": 1.0 + strength * 0.02 * sign},
        "tone_ring_error": {
            "wheel": wheel,
            "amplitude_rad": strength * 0.01,
            "phase_rad": float(rng.uniform(0, 6)),
        },
        "radius_change": {
            "wheel": wheel,
            "deviation_m": size if rng.random() < 0.15 else -size,
            "onset_s": float(rng.uniform(0.2, 0.6)) * end,
            "duration_s": float(rng.choice([0.0, 60.0, 300.0])),
        },
    }
    return table[effect] if effect in table else _strange(effect, strength, size, spec, rng)


def _strange(
    effect: str, strength: float, size: float, spec: Spec, rng: np.random.Generator
) -> dict[str, Any]:
    axle = [2, 3] if rng.random() < 0.5 else [0, 1]
    one = [int(rng.integers(0, 4))]
    begin = float(rng.uniform(0.25, 0.45)) * spec.duration_s
    table: dict[str, dict[str, Any]] = {
        "strange_speed_hump": {
            "at_mps": float(rng.uniform(12, 15) if spec.road == "city" else rng.uniform(17, 24)),
            "width_mps": float(rng.uniform(2, 4)),
            "wheels": axle,
            "size_m": -size,
        },
        "strange_camber": {"wheels": one, "size_m": size},
        "strange_span": {
            "wheels": one,
            "from_s": begin,
            "to_s": begin + float(rng.uniform(120, 300)),
            "size_m": -size,
        },
        "strange_effort": {"wheels": axle, "size_m": -size},
        "strange_brake_heat": {"wheels": axle, "cooling_s": float(rng.uniform(60, 150)), "size_m": size},
        "strange_gyro_warming": {"size_radps": strength * 2e-3, "warming_s": float(rng.uniform(150, 400))},
        "strange_gyro_square": {"per_rad": strength * 0.3},
        "strange_heading_glitch": {
            "size_mps": strength * 0.15,
            "towards_rad": float(rng.uniform(-3.1, 3.1)),
        },
        "strange_doppler_bend": {"size_mps": -strength * 0.15},
    }
    return table[effect]


def _cancelling(
    what: str, strength: float, spec: Spec, rng: np.random.Generator
) -> dict[str, dict[str, Any]]:
    size = strength * LOSS * spec.radius_m
    if what == "growth_slip":  # growth and drag's slip both go with v2, against each other on the driven axle
        return {
            "centrifugal_growth": {"coefficient": size / 900},
            "longitudinal_slip": {
                "slip_per_accel": strength * LOSS / 2,
                "slip_per_speed2": size / 900 / spec.radius_m,
            },
        }
    if what == "track_load":  # cancel at the rear where a_y = v * yaw with v of 18 m/s
        return {
            "track_width_error": {"rear_m": strength * 0.03},
            "load_transfer_lateral": {"coefficient": strength * 0.03 / 2 / 18.0**2 * spec.radius_m},
        }
    if what == "arm_slip":  # forward arm and side-slip turn the course against each other, equal at 15 m/s
        return {
            "antenna_lever_arm": {"forward_m": strength * 0.8, "left_m": 0.0},
            "lateral_slip": {"coefficient": strength * 0.8 / 15.0**2},
        }
    raise ValueError(f"cancel:{what} is no kind that is known")


def _leak_behind_warmup(strength: float, spec: Spec, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    size = strength * LOSS * spec.radius_m
    tau = float(rng.uniform(250, 500))
    return {
        "thermal_growth": {"amplitude_m": size, "time_constant_s": tau},
        "radius_change": {
            "wheel": str(rng.choice(WHEELS)),
            "deviation_m": -size,
            "onset_s": float(rng.uniform(0.05, 0.1)) * spec.duration_s,
            "duration_s": min(1.6 * tau, 0.6 * spec.duration_s),
        },
    }
