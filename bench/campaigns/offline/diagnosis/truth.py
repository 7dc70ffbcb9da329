"""What a case conceals, and how much of it its drive identifies: what is sealed.

In: `Case` and its windows. Out: `Truth`, plain numbers that go into the sealed folder and from there to the
scorer. "Can tell" of an effect: the log-likelihood that it brings under the known noise, once calibration and
the other true effects are fitted (`gain`), and its gain beyond the best other single effect of the
public table, fitted freely (`margin`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from bench.campaigns.offline.diagnosis.draw import EFFECTS, Case
from bench.campaigns.offline.diagnosis.information import explained, gram, without
from bench.campaigns.offline.diagnosis.signals import CHANNELS, Physics, Windows
from bench.worlds.causes import DRIVEN
from bench.worlds.course import Array
from bench.worlds.origins import ORIGINS

WHEELS = ("fl", "fr", "rl", "rr")
ALL = list(WHEELS)
TELLS_GAIN, TELLS_MARGIN = 16.0, 8.0
"""Nats from which a drive is counted as able to tell: a shift of 5.7 standard deviations; and an alternative
that wins by chance in 2 of 100 drives.
"""
GNSS = ["gnss_speed", "gnss_course", "gnss_position"]
WHEEL = ["wheel", "wheel_ratio"]
ONSETS, DURATIONS_S = np.linspace(0.05, 0.9, 14), (0.0, 100.0, 300.0)
TIME_CONSTANTS_S = (150.0, 400.0, 1000.0, 2500.0)


@dataclass
class Concealed:
    """One piece of concealed physics."""

    key: str
    effect: str
    """As the diagnosis should name it."""
    parameters: dict[str, Any]
    gain: float
    margin: float
    alternative: str
    wheels: list[str]
    channels: list[str]
    covariates: list[str]
    spans: list[list[float]]
    """Seconds in which it acts."""
    inherent: bool = False
    """Of the world itself: true when found, and not asked for."""

    @property
    def detectable(self) -> bool:
        """Whether the data identify it."""
        return self.gain >= TELLS_GAIN and self.margin >= TELLS_MARGIN


@dataclass
class Truth:
    """All that a case conceals."""

    kind: str
    strength: float
    seed: int
    world: str
    effects: list[Concealed] = field(default_factory=list)
    beyond: float = 0.0
    """Nats in the world's own physics that no effect of the table can take up."""
    driving_s: int = 0

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Truth:
        """From JSON."""
        return cls(**{**plain, "effects": [Concealed(**each) for each in plain["effects"]]})


CAUSE_IN_CATALOGUE = {"strange_brake_heat": "brake_heat", "strange_heading_glitch": "doppler_heading_error"}
"""Causes that the catalogue holds, by another formula."""


def base_name(key: str) -> str:
    """`radius_change_2` is a radius change."""
    head, _, tail = key.rpartition("_")
    return head if tail.isdigit() else key


def seen_as(key: str) -> str:
    """Return the name that a diagnosis should give."""
    return CAUSE_IN_CATALOGUE.get(key) or ("unknown" if key.startswith("strange") else base_name(key))


def rolling(case: Case) -> dict[str, dict[str, Any]]:
    """The physics of pure rolling: not even slopes shorten the way."""
    return {"no_shortening": {}} if case.spec.hilly > 0.0 else {}


def alone(case: Case, key: str) -> dict[str, dict[str, Any]]:
    """Pure rolling and one piece of the concealed physics."""
    if key == "road_grade":
        return {"road_grade": {}}
    return {**rolling(case), key: case.spec.physics[key]}


def nuisances(windows: Windows) -> Array:
    """(w, 9, k) what calibration takes up: four radii, the gyro's delay, and the Doppler's own age if it has
    one.
    """
    spec, count = windows.spec, len(windows)
    still = windows.channels({})
    out = []
    for wheel in range(4):
        column = np.zeros((count, CHANNELS))
        column[:, wheel] = -still[:, wheel] / spec.radius_m
        out.append(column)
    delay = np.zeros((count, CHANNELS))
    delay[:, 4] = -np.gradient(windows.covariates["yaw_rate"])
    out.append(delay)
    if spec.doppler_age_s > 0.0:
        age = np.zeros((count, CHANNELS))
        age[:, 5], age[:, 6] = -np.gradient(windows.speed), -windows.covariates["yaw_rate"]
        out.append(age)
    return np.stack(out, axis=2)


def alternatives(windows: Windows, base: Physics) -> list[tuple[str, Array]]:
    """Every effect of the public table with its free parameters linearised: name and columns (w, 9, k)."""
    start = windows.channels(base)

    def column(**effect: dict[str, Any]) -> Array:
        return windows.channels({**base, **effect}) - start

    out: list[tuple[str, list[Array]]] = [
        ("centrifugal_growth", [column(centrifugal_growth={"coefficient": 1e-6})]),
        ("load_transfer_longitudinal", [column(load_transfer_longitudinal={"coefficient": 5e-5})]),
        ("load_transfer_lateral", [column(load_transfer_lateral={"coefficient": 5e-5})]),
        (
            "longitudinal_slip",
            [
                column(longitudinal_slip={"slip_per_accel": 1e-3}),
                column(longitudinal_slip={"slip_per_speed2": 5e-7}),
            ],
        ),
        ("lateral_slip", [column(lateral_slip={"coefficient": 2e-3})]),
        ("gnss_latency", [column(gnss_latency={"latency_s": 0.05})]),
        (
            "antenna_lever_arm",
            [column(antenna_lever_arm={"forward_m": 0.5}), column(antenna_lever_arm={"left_m": 0.2})],
        ),
        (
            "track_width_error",
            [column(track_width_error={"rear_m": 0.02}), column(track_width_error={"front_m": 0.02})],
        ),
        ("yaw_rate_bias", [column(yaw_rate_bias={"bias": 1e-3})]),
        ("yaw_rate_scale", [column(yaw_rate_scale={"scale": 1.01})]),
    ]
    if windows.spec.driven == "all":
        out.append(("drive_split", [column(drive_split={"difference": 1e-3})]))
    if windows.spec.hilly > 0.0:
        out.append(("road_grade", [windows.channels({}) - windows.channels({"no_shortening": {}})]))
    for tau in TIME_CONSTANTS_S:
        out.append(("thermal_growth", [column(thermal_growth={"amplitude_m": 1e-3, "time_constant_s": tau})]))
    time_s, end = windows.covariates["time"], float(len(windows))
    for wheel in range(4):
        per_metre = -start[:, wheel] / windows.spec.radius_m
        for onset in ONSETS * end:
            for long in DURATIONS_S:
                share = np.clip((time_s - onset) / max(long, 1e-9), 0.0, 1.0)
                ramp = np.zeros((len(windows), CHANNELS))
                ramp[:, wheel] = 1e-3 * per_metre * share
                out.append((f"radius_change {WHEELS[wheel]}", [ramp]))
    return [(name, np.stack(columns, axis=2)) for name, columns in out]


def truth_of(case: Case, windows: Windows) -> Truth:
    """What is concealed and what of it is identifiable."""
    out = Truth(case.kind, case.strength, case.seed, case.world, driving_s=int(windows.read[:, 0].sum()))
    own = windows.channels(rolling(case))
    if ORIGINS[case.world].own_tyres:
        out.effects, out.beyond = _inherent(windows, case.wanted)
    if not case.wanted:
        return out
    parts = [windows.channels(alone(case, key)) - own for key in case.wanted]
    fixed = nuisances(windows)
    others = alternatives(windows, rolling(case))
    columns = np.concatenate([np.stack(parts, axis=2), fixed, *(each for _, each in others)], axis=2)
    count = len(parts)
    inner = without(gram(windows, columns), list(range(count, count + fixed.shape[2])))
    for k, key in enumerate(case.wanted):
        rest = without(inner, [other for other in range(count) if other != k])
        gain = 0.5 * float(rest[k, k])
        best, alternative, at = 0.0, "", count + fixed.shape[2]
        for name, each in others:
            group = list(range(at, at + each.shape[2]))
            at += each.shape[2]
            if name == _own_name(case, key):
                continue
            share = explained(rest, k, group)
            if share > best:
                best, alternative = share, name
        if base_name(key) == "tone_ring_error":
            amplitude_rad = case.spec.physics["tone_ring_error"]["amplitude_rad"]
            gain, best, alternative = tooth_gain(windows, amplitude_rad), 0.0, ""
        where = _where(case, key, windows, parts[k])
        out.effects.append(
            Concealed(
                key=key,
                effect=seen_as(key),
                parameters=dict(case.spec.physics[key]),
                gain=gain,
                margin=gain - best,
                alternative=alternative,
                **where,
            )
        )
    return out


def _own_name(case: Case, key: str) -> str:
    if base_name(key) == "radius_change":
        return f"radius_change {case.spec.physics[key]['wheel']}"
    return base_name(key)


def tooth_gain(windows: Windows, amplitude_rad: float) -> float:
    """Once-per-turn errors are too quick for windows: each frame's reading against its own noise."""
    spec = windows.spec
    grain = 2 * math.pi / spec.teeth / math.sqrt(12)
    frames = spec.wheel_hz
    if spec.wheel_signal == "speeds":
        omega = windows.speed / spec.radius_m
        error = math.hypot(
            spec.speed_step_kmh / 3.6 / math.sqrt(12) / spec.radius_m, spec.edge_noise_rad * 70.0
        )
        size = np.asarray(amplitude_rad * omega)
        return float(0.25 * frames * (size[windows.read[:, 0]] ** 2).sum() / error**2)
    # between two edges the same count is read again, which tells nothing new
    edges = windows.speed / spec.radius_m * spec.teeth / (2 * math.pi)
    fresh = np.minimum(edges, frames)[windows.read[:, 0]]
    return float(0.25 * fresh.sum() * amplitude_rad**2 / (grain**2 + spec.edge_noise_rad**2))


def _inherent(windows: Windows, injected: Sequence[str]) -> tuple[list[Concealed], float]:
    """What the multi-body car's own tyres do: all that its equations hold beyond pure rolling.

    Slip, and in bends tyres that turn by 1e-4 to 6e-4 s2/m of the lateral acceleration less on the left
    than on the right (`python -m bench.campaigns.offline.diagnosis.own_physics` prints it): by the public
    table's definition that is load transfer, whatever in the tyres makes it.
    """
    rigid = windows.rigid()
    change = windows.channels({}) - rigid.channels({})
    fixed, others = nuisances(windows), alternatives(rigid, {})
    groups = [(name, each) for name, each in others if not name.startswith(("radius_change", "thermal"))]
    columns = np.concatenate([change[:, :, None], fixed, *(each for _, each in groups)], axis=2)
    inner = without(gram(windows, columns), list(range(1, 1 + fixed.shape[2])))
    at, chosen, found = 1 + fixed.shape[2], [], []
    place: dict[str, list[int]] = {}
    for name, each in groups:
        place[name] = list(range(at, at + each.shape[2]))
        at += each.shape[2]
    # whatever else fits is a likeness
    own = {"longitudinal_slip": (list(WHEELS), WHEEL), "lateral_slip": ([], GNSS)}
    if "load_transfer_lateral" not in injected:
        own["load_transfer_lateral"] = (list(WHEELS), WHEEL)
    for name, where in own.items():
        gain = explained(without(inner, chosen), 0, place[name])
        chosen += place[name]
        found.append(
            Concealed(
                key=name,
                effect=name,
                parameters={},
                gain=gain,
                margin=gain,
                alternative="",
                wheels=where[0],
                channels=where[1],
                covariates=["accel_long", "speed", "accel_lat"],
                spans=[[0.0, float(len(windows))]],
                inherent=True,
            )
        )
    return found, 0.5 * float(without(inner, chosen)[0, 0])


def _where(case: Case, key: str, windows: Windows, change: Array) -> dict[str, Any]:
    """Wheels, channels and covariates in which it shows, and when."""
    p = case.spec.physics[key]
    driven = [w for w, share in zip(WHEELS, DRIVEN[case.spec.driven], strict=True) if share > 0]
    rear, front = float(p.get("rear_m", 0.0)) != 0.0, float(p.get("front_m", 0.0)) != 0.0
    axles = [*(ALL[:2] if front else []), *(ALL[2:] if rear else [])]
    wheels = [WHEELS[k] for k in p["wheels"]] if "wheels" in p else []
    table: dict[str, tuple[list[str], list[str], list[str]]] = {
        "radius_change": ([str(p.get("wheel"))], WHEEL, ["time"]),
        "centrifugal_growth": (ALL, WHEEL, ["speed"]),
        "thermal_growth": (ALL, WHEEL, ["time", "temperature"]),
        "load_transfer_longitudinal": (ALL, WHEEL, ["accel_long", "torque"]),
        "load_transfer_lateral": (ALL, WHEEL, ["accel_lat"]),
        "longitudinal_slip": (driven, WHEEL, ["accel_long", "torque", "speed"]),
        "lateral_slip": ([], GNSS, ["accel_lat"]),
        "road_grade": (ALL, [*WHEEL, *GNSS], ["grade"]),
        "gnss_latency": ([], GNSS, ["accel_long", "speed", "yaw_rate"]),
        "antenna_lever_arm": ([], GNSS, ["yaw_rate"]),
        "track_width_error": (axles, WHEEL, ["yaw_rate", "steering"]),
        "tone_ring_error": ([str(p.get("wheel"))], WHEEL, ["wheel_angle"]),
        "yaw_rate_bias": ([], ["yaw_rate"], ["time"]),
        "yaw_rate_scale": ([], ["yaw_rate"], ["yaw_rate"]),
        "strange_speed_hump": (wheels, WHEEL, ["speed"]),
        "strange_camber": (wheels, WHEEL, ["accel_lat", "yaw_rate", "steering"]),
        "strange_span": (wheels, WHEEL, ["time", "distance"]),
        "strange_effort": (wheels, WHEEL, ["accel_long", "torque"]),
        "strange_brake_heat": (wheels, WHEEL, ["time", "distance", "accel_long"]),
        "strange_gyro_warming": ([], ["yaw_rate"], ["time", "temperature", "distance"]),
        "strange_gyro_square": ([], ["yaw_rate"], ["yaw_rate", "accel_lat", "steering"]),
        "strange_heading_glitch": ([], GNSS, ["time", "distance"]),
        "strange_doppler_bend": ([], GNSS, ["yaw_rate", "accel_lat", "steering"]),
    }
    name = base_name(key)
    on, channels, covariates = table[name]
    if name == "radius_change":
        spans = [[float(p["onset_s"]), float(len(windows))]]
    elif name in ("thermal_growth", "yaw_rate_bias", "tone_ring_error", "strange_gyro_warming"):
        spans = [[0.0, float(len(windows))]]
    else:
        # slopes show in what the receiver says, though it is the wheels that go the longer way
        acting = change[:, :4] if on and name != "road_grade" else change[:, 4:7]
        spans = _acting(acting, covariates[0], windows)
    return {"wheels": list(on), "channels": channels, "covariates": covariates, "spans": spans}


def _acting(change: Array, covariate: str, windows: Windows) -> list[list[float]]:
    """When an effect acts: windows whose covariate lies where 95 % of its energy is."""
    read = windows.read[:, 0]
    energy = ((change - change[read].mean(axis=0)) ** 2).sum(axis=1) * read
    values = windows.covariates[covariate]
    order = np.argsort(values)
    share = np.cumsum(energy[order]) / max(float(energy.sum()), 1e-300)
    low, high = np.interp([0.025, 0.975], share, values[order])
    if covariate in ("time", "distance"):
        inside = energy > 0.25 * energy.max()
    else:
        inside = (values >= low) & (values <= high)
    return spans_of(inside & read)


def spans_of(mask: np.ndarray) -> list[list[float]]:
    """Runs of a mask over windows, in seconds."""
    edge = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    return [
        [float(a), float(b)]
        for a, b in zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1), strict=True)
    ]


def detectable_names(truth: Truth) -> list[str]:
    """Names that a diagnosis should give, for effects that the data identify."""
    return [each.effect for each in truth.effects if each.detectable and not each.inherent]


__all__ = ["EFFECTS", "Concealed", "Truth", "detectable_names", "nuisances", "rolling", "truth_of"]
