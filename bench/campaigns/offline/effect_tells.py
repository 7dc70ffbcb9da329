"""How surely a drive can tell an effect of `effect_cases.py`: nats under the known noise, and beyond
alternatives.

In: effect, drive, windows. Out: `Tells`: the log-likelihood that the cause brings once calibration is fitted
(`gain`), and what of it no other effect of the catalogue can take up by itself (`margin`). Nothing of the
program that is tested is used.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.campaigns.offline.diagnosis.information import explained, gram, without
from bench.campaigns.offline.diagnosis.signals import Windows, window_means
from bench.campaigns.offline.diagnosis.truth import TELLS_GAIN, TELLS_MARGIN, nuisances, tooth_gain
from bench.campaigns.offline.effect_cases import CASES, Drawn, draw
from bench.worlds.causes import accelerations, clock_error_s, steering_wheel
from bench.worlds.course import Array
from bench.worlds.instruments import STEERING_RATIO
from bench.worlds.spec import Spec

READINGS: Mapping[str, tuple[tuple[str, ...], float]] = {
    "acceleration": (("accelerometer_bias", "accelerometer_tilt", "road_bank"), 0.1),
    "steering": (("steering_offset", "steering_ratio_error", "compliance_steer"), 0.01),
    "clock": (("clock_drift",), 0.01),
}
"""Effects that show in a reading alone, and the reading's error against the motion (m/s2, rad, s)."""
CORRELATED_WINDOWS = 10.0
"""Windows of a second over which such an error stays the same."""
DRAWS = 3
"""Of each alternative."""
SPANNED = (
    *("accelerometer_bias", "accelerometer_tilt", "antenna_lever_arm", "doppler_heading_error"),
    *("head_wind", "inner_wheel_slip", "longitudinal_slip", "sun_side", "track_width_error"),
)
"""Effects of several values that enter linearly, which the draws of an alternative span; of others each draw
is a alternative by itself."""
GIVES_WAY = {
    "longitudinal_slip": "drive_slip_curve",
    "load_transfer_longitudinal": "drive_split",
    "track_width_error": "locked_differential",
}
"""Effects and those that contain them as a limit, which are no alternatives of them."""
FORMULAS_SHARE = 1e-3
"""Of the gain: less beyond an alternative is no more than what two formulas of one effect differ by."""
MIN_STOPS = 2
SHORTEST_STOP_S = 20.0
"""In less nobody gets in."""


@dataclass(frozen=True)
class Tells:
    """Nats."""

    gain: float
    margin: float
    alternative: str

    @property
    def can(self) -> bool:
        """Whether the drive identifies the effect."""
        return self.gain >= TELLS_GAIN and self.margin >= max(TELLS_MARGIN, FORMULAS_SHARE * self.gain)


def tells(effect: str, drawn: Drawn, windows: Windows) -> Tells:
    """Of one drive."""
    for group, (names, noise) in READINGS.items():
        if effect in names:
            return _in_reading(effect, drawn, windows, group, names, noise)
    if effect == "tone_ring_error":
        return Tells(gain := tooth_gain(windows, drawn.truth["amplitude_rad"]), gain, "")
    if effect == "counter_lost_low_speed":
        stops = int(np.count_nonzero(np.diff((windows.course.speed < 0.2).astype(int)) == 1))
        return Tells(float("inf") if stops >= MIN_STOPS else 0.0, float("inf"), "")
    if effect == "load_static" and _longest_stop_s(windows) < SHORTEST_STOP_S:
        return Tells(0.0, 0.0, "")
    windows = replace(windows, spec=_with_scatter(windows))
    base = {"no_shortening": {}} if effect == "road_grade" else {}
    still = windows.channels(base)
    own = windows.channels(drawn.physics) - still
    others = list(_alternatives(effect, drawn, windows))
    fixed = nuisances(windows)
    inner = without(
        gram(windows, np.concatenate([own[:, :, None], fixed, *(each for _, each in others)], axis=2)),
        list(range(1, 1 + fixed.shape[2])),
    )
    gain, best, alternative, at = 0.5 * float(inner[0, 0]), 0.0, "", 1 + fixed.shape[2]
    for name, columns in others:
        share = explained(inner, 0, list(range(at, at + columns.shape[2])))
        at += columns.shape[2]
        if share > best:
            best, alternative = share, name
    return Tells(gain, gain - best, alternative)


def _longest_stop_s(windows: Windows) -> float:
    course = windows.course
    return float(np.max(np.diff(course.time_s[course.speed > 0.2]), initial=0.0))


def _with_scatter(windows: Windows) -> Spec:
    """The specification with the scatter of pulses that come at random, as if all wheels had it."""
    spec = windows.spec
    if "pulses" not in spec.physics:
        return spec
    pitch_m = 2.0 * math.pi / spec.teeth * spec.radius_m
    mean_mps = float(windows.speed[windows.read[:, 0]].mean())
    scatter = pitch_m * math.sqrt(abs(spec.physics["pulses"]["per_s"]) / mean_mps)
    return replace(spec, rough=math.hypot(spec.rough, scatter))


def generator(effect: str, seed: int, use: int) -> np.random.Generator:
    """Of one effect's drive; `use` keeps draws apart."""
    return np.random.default_rng([seed, zlib.crc32(effect.encode()), use])


def _alternatives(effect: str, drawn: Drawn, windows: Windows) -> Iterator[tuple[str, Array]]:
    still = windows.channels({})
    skipped = {effect, GIVES_WAY.get(effect, ""), *drawn.also}
    for name in CASES:
        columns = []
        for number in range(DRAWS):
            one = draw(name, generator(name, number, 7))
            if name not in skipped and _possible(one, windows):
                columns.append(windows.channels(one.physics) - still)
        columns = [each for each in columns if np.abs(each[windows.read]).max() > 1e-9]
        groups = [[each] for each in columns] if name not in SPANNED else [columns] if columns else []
        for group in groups:
            yield name, np.stack(group, axis=2)


def _possible(one: Drawn, windows: Windows) -> bool:
    """Whether such a bus, car and drive can have it."""
    spec = windows.spec
    same = one.fixed.get("wheel_signal", spec.wheel_signal) == spec.wheel_signal
    same &= one.fixed.get("driven") != "all" or spec.driven == "all"
    has = all(getattr(spec, key) for key in ("with_gyro", "with_temperature") if one.fixed.get(key))
    hills = one.fixed.get("hilly", 0.0) == 0.0 or spec.hilly > 0.0
    stood = "luggage" not in one.physics or bool((windows.course.speed < 0.2).any())
    return same and has and hills and stood


def _in_reading(
    effect: str, drawn: Drawn, windows: Windows, group: str, names: tuple[str, ...], noise: float
) -> Tells:
    own = _shown(drawn.physics, windows, group)
    offset = np.ones((len(own), 1)) if group == "clock" else np.zeros((len(own), 0))
    own = own - offset @ np.linalg.lstsq(offset, own, rcond=None)[0]
    scale = 2.0 * noise**2 * CORRELATED_WINDOWS
    best, alternative = 0.0, ""
    for name in names:
        if name != effect:
            columns = [
                _shown(draw(name, generator(name, k, 7)).physics, windows, group) for k in range(DRAWS)
            ]
            A = np.stack(columns, axis=1)
            part = A @ np.linalg.lstsq(A, own, rcond=None)[0]
            if float(part @ part) > best:
                best, alternative = float(part @ part), name
    energy = float(own @ own)
    return Tells(energy / scale, (energy - best) / scale, alternative)


def _shown(physics: Mapping[str, Any], windows: Windows, group: str) -> Array:
    """(k,) what a reading shows more than without the physics, while the car drives."""
    course, count = windows.course, len(windows)
    spec, bare = replace(windows.spec, physics=dict(physics)), replace(windows.spec, physics={})
    if group == "clock":
        parts = [clock_error_s(course.time_s, spec)]
    elif group == "steering":
        parts = [steering_wheel(course, s, STEERING_RATIO) for s in (spec, bare)]
        parts = [parts[0] - parts[1]]
    else:
        parts = [a - b for a, b in zip(accelerations(course, spec), accelerations(course, bare), strict=True)]
    on = windows.read[:, 0]
    return np.concatenate([window_means(part, count)[on] for part in parts])
