"""Evidence of a drive against a configuration.

In: the configuration, its DBC, frames and fixes. Out: `Suspicion`s with key, probability and what to write
instead.

Each is a test of one statement of the file, on the same regressions that `discover` rests on. Its
probability is that of
the other hypothesis against the stated one, with floors for what a right file may be off by.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from cantools.database.can import Database
from scipy.stats import norm

from tpmsd.car.config.model import Config
from tpmsd.car.config.units import UNITS, allowed_units, canonical_unit, to_si
from tpmsd.car.rings.ring import counts_of, counts_per_m, radius_of
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.discovery.assign import Assignment, Role
from tpmsd.offline.discovery.clock_offset import best_offset
from tpmsd.offline.discovery.configured import configured_fields, configured_frames
from tpmsd.offline.discovery.frames import BusLog, MessageLog
from tpmsd.offline.discovery.geometry import CarGeometry, driven_axle
from tpmsd.offline.discovery.material import Material, prepare
from tpmsd.offline.discovery.other_roles import physical, smooth
from tpmsd.offline.discovery.reference import Reference, make_reference
from tpmsd.offline.discovery.series import Field, Series, as_count, as_value
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.offline.discovery.wheels import Follower, followers, placed
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT, EXTENDED
from tpmsd.onboard.sources.events import GnssFix

_UNITS = ("km/h", "m/s", "mph", "knots")


@dataclass(frozen=True, slots=True)
class Suspicion:
    """One statement of the file that the drive speaks against."""

    key: str
    suspicion: str
    probability: float
    suggest: str


def suspicions(
    config: Config,
    database: Database,
    log: BusLog,
    fixes: Sequence[GnssFix],
    settings: Settings = SETTINGS,
) -> list[Suspicion]:
    """Return all of them, the surest first; of several of the same key and kind the surest."""
    found: list[Suspicion] = []
    fields = configured_fields(config, database, log)
    frames = configured_frames(config, database, log, fields)
    for role, one in fields.items():
        if role not in frames:
            number = one.key & (1 << BUS_SHIFT) - 1 & ~EXTENDED
            what = f"no frame of {one.message} (identifier {number:#05x}) in the drive"
            key = f"can.signals.{role}"
            found.append(Suspicion(key, "message_never_seen", 0.999, f"{what}: wrong DBC or bus?"))
    shifted, offset = _aligned(config, fields, frames, fixes)
    if offset is not None:
        found.append(offset)
    material = prepare(log, shifted, database, settings)
    found += _wheels(config, _read(fields, frames, material.reference.edge_s), material, settings)
    surest: dict[tuple[str, str], Suspicion] = {}
    for one_said in sorted(found, key=lambda one: -one.probability):
        surest.setdefault((one_said.key, one_said.suspicion), one_said)
    return list(surest.values())


def _aligned(
    config: Config, fields: dict[str, Field], frames: dict[str, MessageLog], fixes: Sequence[GnssFix]
) -> tuple[Sequence[GnssFix], Suspicion | None]:
    """Return the fixes on the frames' clock, and the suspicion where they were not."""
    role = next((r for r in frames if r.startswith("wheel_")), None)
    reference = make_reference(fixes)
    if role is None or len(reference.fix_s) < 10 or not len(frames[role].time_s):
        return fixes, None
    message = frames[role]
    edges = np.arange(np.ceil(message.time_s[0]), message.time_s[-1], 1.0)
    if len(edges) < 3:
        return fixes, None
    raw = message.bits(fields[role].layout)
    one = (
        as_count(fields[role], message, raw, edges)
        if role.startswith("wheel_count_")
        else as_value(fields[role], message, raw, edges)
    )
    if one is None:
        return fixes, None
    per_metre = counts_per_m(config.vehicle.teeth_per_rev, config.vehicle.wheel_radius_m[2])
    speed = one.rate * abs(fields[role].scale) / (per_metre if one.kind == "count" else 3.6)
    best = best_offset(0.5 * (edges[1:] + edges[:-1]), speed, reference.fix_s, reference.fix_speed_mps)
    if best is None:
        return fixes, None
    offset_s, there, here = best
    stated = config.gnss.latency_s or 0.0
    if abs(offset_s + stated) <= SETTINGS.clocks_apart_s or there < 0.97:
        return fixes, None
    readings = (edges[-1] - edges[0]) / SETTINGS.independent_s
    if (
        math.isfinite(here)
        and 0.5 * readings * math.log((1.0 - here**2) / (1.0 - there**2)) < SETTINGS.clocks_apart_nats
    ):
        return fixes, None
    apart = fixes[0].arrival_s > message.time_s[-1] or fixes[-1].arrival_s < message.time_s[0]
    said = "the recordings do not overlap; " if apart else ""
    digits = 0 if abs(offset_s) >= 5.0 else 1
    late, shift = f"{-offset_s:+.{digits}f}", f"{offset_s:+.{digits}f}"
    suggest = f"{said}the fixes' stamps are {late} s off: shift them by {shift} s"
    moved = [replace(fix, arrival_s=fix.arrival_s + offset_s) for fix in fixes]
    return moved, Suspicion("gnss", "clock_offset", min(0.999, there), suggest)


def _read(
    fields: Mapping[str, Field], frames: Mapping[str, MessageLog], edges: FloatArray
) -> dict[str, Series]:
    """Return a mapping role -> its readings over the cells; roles that stay the same or cannot be read are
    left out."""
    read = {}
    for role, log in frames.items():
        raw = log.bits(fields[role].layout)
        if len(raw) < 20 or raw.min() == raw.max():
            continue
        made = (as_count if role.startswith("wheel_count_") else as_value)(fields[role], log, raw, edges)
        if made is not None:
            read[role] = made
    return read


def _wheels(
    config: Config, read: Mapping[str, Series], material: Material, settings: Settings
) -> list[Suspicion]:
    found: list[Suspicion] = []
    series = {role: made for role, made in read.items() if role.startswith("wheel_")}
    for role, made in series.items():
        stated = int(made.field.unit.split()[1]) if made.kind == "count" else 0
        if made.modulus_seen and made.modulus != stated:
            suggest = f"modulus = {made.modulus}: a step over the end falls short by that, not {stated}"
            found.append(Suspicion(f"can.signals.{role}", "wrong_modulus", 0.99, suggest))
    following = {
        role: one_found
        for role, made in series.items()
        for one_found in followers([made], material.reference, settings)
    }
    for role, one_follower in following.items():
        wrong = _scale(config, role, one_follower)
        if wrong is not None:
            found.append(wrong)
    by_wheel = {role[-2:]: role for role in following}
    members = placed(list(following.values()), material.reference, material.gyro, settings)
    by_position = {role[-2:]: one for role, one in zip(following, members, strict=True)}
    found += _sides(by_wheel, by_position)
    if {"rl", "rr"} <= by_position.keys():
        found += _car(config, by_wheel, by_position, read, material, settings)
    return found


def _scale(config: Config, role: str, one: Follower) -> Suspicion | None:
    """Return counts per metre against teeth and radius; a speed against its unit."""
    wheel = WHEELS.index(role[-2:])
    radius = config.vehicle.wheel_radius_m[wheel]
    if one.series.kind == "count":
        per_metre = one.per_mps * abs(one.series.field.scale)
        teeth = config.vehicle.teeth(wheel)
        error = math.log(teeth / counts_of(per_metre, radius))
        probability = _against(error, SETTINGS.right_radius_std)
        fitting = round(counts_of(per_metre, radius))
        if probability < SETTINGS.decided or fitting == teeth:
            return None
        suggest = f"{fitting} counts per revolution go with a radius of {radius:g} m; {teeth:g} would need "
        suggest += f"{radius_of(teeth, per_metre):.3f} m"
        return Suspicion("vehicle.teeth_per_rev", "wrong_teeth", probability, suggest)
    unit = canonical_unit(one.series.field.unit) or "km/h"
    kind, factor, _ = UNITS[unit]
    mps = factor * (radius if kind == "angular speed" else 1.0)
    error = math.log(one.per_mps * abs(one.series.field.scale) * mps)
    probability = _against(error, SETTINGS.right_speed_std)
    if probability < SETTINGS.decided or abs(error) < 0.05:
        return None
    key = f"can.signals.{role}"
    seen = 1.0 / (one.per_mps * abs(one.series.field.scale))
    for other in _UNITS:
        if other != unit and abs(math.log(seen / UNITS[other][1])) < 0.05:
            suggest = f'unit = "{other}": the receiver sees {seen / mps:.3f} times the speed'
            return Suspicion(key, "wrong_unit", probability, suggest)
    scale = one.series.field.scale * seen / mps
    suggest = f"scale = {scale:.6g}: the receiver sees {seen / mps:.3f} times the speed"
    return Suspicion(key, "wrong_scale", probability, suggest)


def _against(error: float, std: float) -> float:
    """Return the probability that an error is not one of a right file."""
    right = norm.logpdf(error, 0.0, std)
    wrong = norm.logpdf(error, 0.0, SETTINGS.wrong_scale_std) if abs(error) < 0.3 else 0.0
    return min(0.999, float(1.0 / (1.0 + 9.0 * math.exp(min(right - wrong, 50.0)))))


def _sides(by_wheel: dict[str, str], by_position: dict[str, Follower]) -> list[Suspicion]:
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
        # Two hypotheses: the track, or minus the track; a prior of one file in fifty.
        ratio = norm.logpdf(span, -track, spread) - norm.logpdf(span, track, spread) + math.log(0.02)
        probability = min(0.999, float(1.0 / (1.0 + math.exp(-min(max(ratio, -50.0), 50.0)))))
        if probability >= SETTINGS.decided:
            names = f"{one.series.field.signal} is on the right and {other.series.field.signal} on the left"
            found.append(Suspicion(f"can.signals.{by_wheel[left]}", "swapped_left_right", probability, names))
    return found


def _car(
    config: Config,
    by_wheel: dict[str, str],
    by_position: dict[str, Follower],
    read: Mapping[str, Series],
    material: Material,
    settings: Settings,
) -> list[Suspicion]:
    four = len(by_position) == 4
    wheels = WHEELS if four else ("rl", "rr")
    kind = "counts" if by_position["rl"].series.kind == "count" else "speeds"
    swapped_sides = by_position["rl"].lateral_m < by_position["rr"].lateral_m
    order = {w: (w[0] + ("r" if w[1] == "l" else "l") if swapped_sides else w) for w in wheels}
    roles = tuple(Role(w, by_position[order[w]], 1.0, ()) for w in wheels)
    found: list[Suspicion] = []
    assignment = Assignment(kind, roles, not four, 1.0, 1.0)
    geometry = CarGeometry(assignment, material.reference, material.gyro, settings)
    turned = False
    if four and geometry.square_m2 is not None:
        square, std = geometry.square_m2.value, math.hypot(geometry.square_m2.std, 0.5)
        aim, spread = config.vehicle.wheelbase_m**2, math.hypot(std, 0.3 * config.vehicle.wheelbase_m)
        ratio = norm.logpdf(square, -aim, spread) - norm.logpdf(square, aim, spread) + math.log(0.02)
        probability = min(0.999, float(1.0 / (1.0 + math.exp(-min(max(ratio, -50.0), 50.0)))))
        turned = probability >= SETTINGS.decided
        if turned:
            key = f"can.signals.{by_wheel['fl']}"
            suggest = "in bends the wheels called rear have the longer way: exchange front and rear"
            found.append(Suspicion(key, "swapped_front_rear", probability, suggest))
    axle = driven_axle(assignment)
    if axle is not None and config.vehicle.driven_axle in ("front", "rear"):
        name, probability = axle
        if turned:
            name = "rear" if name == "front" else "front"
        if name != config.vehicle.driven_axle and probability >= 0.99:
            suggest = f'driven_axle = "{name}": its wheels turn faster under acceleration'
            found.append(Suspicion("vehicle.driven_axle", "wrong_driven_axle", probability, suggest))
    if not turned:
        found += _antenna(config, geometry)
    return found + _other_signals(config, read, material.reference, geometry.motion()[0])


def _antenna(config: Config, geometry: CarGeometry) -> list[Suspicion]:
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


def _other_signals(
    config: Config, read: Mapping[str, Series], reference: Reference, speed: FloatArray
) -> list[Suspicion]:
    """Return the sign and size of the other roles against the car's motion, by receiver and wheels."""
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
            found.append(_wrong_size(role, key, unit, gain, probability))
    return found


def _wrong_size(role: str, key: str, unit: str, gain: float, probability: float) -> Suspicion:
    """Return the suspicion of a signal that is `gain` times the right value: by another unit of the role, or
    another scale."""
    factor, _ = to_si(role, unit)
    others = {other: to_si(role, other)[0] for other in allowed_units(role)}
    fitting = min(others, key=lambda other: abs(math.log(others[other] * gain / factor)))
    seen = f"it is {gain:.3g} times what the car's motion tells"
    if others[fitting] != factor and abs(math.log(others[fitting] * gain / factor)) < SETTINGS.unit_near:
        return Suspicion(key, "wrong_unit", probability, f'unit = "{fitting}": {seen}')
    return Suspicion(key, "wrong_scale", probability, seen)
