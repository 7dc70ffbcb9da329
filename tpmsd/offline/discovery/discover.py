"""Discovery of a bus's content from the frames and fixes of a drive.

In: `BusLog`, fixes, a DBC where there is one, the tyre's size, the car library. Out: `BusDiscovery`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from cantools.database.can import Database

from tpmsd.car.config.units import UNITS, canonical_unit
from tpmsd.car.rings.ring import radius_from_counts_m
from tpmsd.offline.discovery.assign import Assignment, assign
from tpmsd.offline.discovery.candidates import candidates
from tpmsd.offline.discovery.frames import BusLog
from tpmsd.offline.discovery.geometry import CarGeometry, driven_axle, per_metre
from tpmsd.offline.discovery.library import CarPlatform, Match, match_car
from tpmsd.offline.discovery.other_roles import other_roles
from tpmsd.offline.discovery.prepared_log import PreparedLog, dbc_fields, prepare
from tpmsd.offline.discovery.result import BusDiscovery, Estimate, FoundRole, Undecided
from tpmsd.offline.discovery.series import MessageField, unwrap
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.offline.discovery.wheels import (
    Follower,
    clusters,
    followers,
    groups_by_lag,
    physical_scale,
    receiver_position_fit,
    with_positions,
)
from tpmsd.offline.rings.counter import Counter
from tpmsd.offline.rings.tooth_count import ToothCount, count_prior, tooth_count, tyre_radius_m
from tpmsd.onboard.sources.events import GnssFix

_SPEED_UNITS = ("km/h", "m/s", "mph", "knots")
_NICE_KMH = (
    0.01,
    0.02,
    0.05,
    0.1,
    0.0075,
    0.05625,
    1 / 16,
    1 / 32,
    1 / 64,
    1 / 100,
    1 / 128,
    1 / 256,
    0.5,
    1.0,
)


def discover(
    log: BusLog,
    fixes: Sequence[GnssFix],
    database: Database | None = None,
    tyre: str | None = None,
    cars: Sequence[CarPlatform] = (),
    settings: Settings = SETTINGS,
) -> BusDiscovery:
    """Return the wheels' signals and other roles of a bus, the car's geometry and receiver, by the frames and
    fixes of a drive; `cars`: the car library, as prior.
    """
    return discover_prepared(prepare(log, fixes, database, settings), tyre, cars, database, settings)


def discover_prepared(
    material: PreparedLog,
    tyre: str | None = None,
    cars: Sequence[CarPlatform] = (),
    database: Database | None = None,
    settings: Settings = SETTINGS,
) -> BusDiscovery:
    """Return the discovery of a prepared drive; what cannot be decided is listed in `undecided`."""
    reference = material.reference
    nothing = BusDiscovery(
        None,
        duration_s=reference.duration_s,
        frames=material.frames,
        has_dbc=material.has_dbc,
        channels=material.channels,
    )
    if reference.duration_s < settings.min_drive_s:
        why = f"only {reference.duration_s:.0f} s of driving above 2 m/s with fixes"
        return replace(
            nothing, undecided=_undecided_wheels(why, "10 min of mixed driving with the sky in view")
        )
    match = None if database is None else match_car(cars, dbc_fields(database, material.logs))
    best = _best_assignment(material, match, settings)
    if best is None:
        return _without_wheels(nothing, material, settings)
    assignment = best
    car = None if match is None or not _agrees_with_match(assignment, match) else match.car
    undecided: list[Undecided] = []
    roles = _wheel_roles(assignment, undecided, settings)
    name = None if car is None else car.name
    found = replace(nothing, kind=assignment.kind, roles=roles, assignment=assignment, car=name)
    found, radius = _ring_and_radius(found, assignment, material, tyre, car, undecided, settings)
    geometry = CarGeometry(assignment, reference, material.gyro, settings)
    measures = {"wheel_radius_m": Estimate(radius.value, max(radius.std, 0.001)), **geometry.geometry}
    axle = driven_axle(assignment)
    if axle is None or axle[1] < settings.decided:
        why = "the axles' slip does not differ clearly" if axle else "one axle alone is on the bus"
        undecided.append(
            Undecided("vehicle.driven_axle", why, "brisk acceleration on a straight road, ten times")
        )
    undecided += _undecided_measures(measures, geometry.gnss, assignment)
    if material.has_dbc:
        wheels = {role.follower.series.field.signal for role in assignment.roles}
        speed, yaw = geometry.motion()
        others = other_roles(material.series, reference, speed, yaw, wheels, settings)
        found.roles.update(others)
        undecided += [
            Undecided(
                f"can.signals.{role}", f"{one.probability:.2f} for {one.field.signal}", "more bends and stops"
            )
            for role, one in others.items()
            if one.probability < settings.decided
        ]
    return replace(found, driven_axle=axle, geometry=measures, gnss=geometry.gnss, undecided=tuple(undecided))


def _ring_and_radius(
    found: BusDiscovery,
    assignment: Assignment,
    material: PreparedLog,
    tyre: str | None,
    car: CarPlatform | None,
    undecided: list[Undecided],
    settings: Settings,
) -> tuple[BusDiscovery, Estimate]:
    """Return the result with the counts per revolution, where wheels are counted, and the rolling radius (m).

    A number of counts that is not decided joins `undecided`.
    """
    if assignment.kind != "counts":
        radius = (tyre_radius_m(tyre, settings) if tyre else None) or settings.radius_m
        return found, Estimate(radius, radius * settings.tyre_radius_std if tyre else settings.radius_std_m)
    teeth = _counts_per_revolution(assignment, material, tyre, car, settings)
    if teeth.probability < settings.decided:
        undecided.append(_undecided_counts(teeth, tyre))
    counted = replace(
        found,
        counts_per_rev=Estimate(teeth.value, teeth.std),
        counts_probability=teeth.probability,
        counts_alternatives=teeth.alternatives,
        contradictions=_tyre_size_warning(teeth, tyre, car),
    )
    return counted, Estimate(teeth.radius_m, teeth.std / max(teeth.value, 1.0) * teeth.radius_m)


def _counts_per_revolution(
    assignment: Assignment,
    material: PreparedLog,
    tyre: str | None,
    car: CarPlatform | None,
    settings: Settings,
) -> ToothCount:
    """Return counts per revolution; those of a known car are taken as they are."""
    followers_found = [role.follower for role in assignment.roles]
    counted, counted_std = per_metre(followers_found)
    if car is not None and car.teeth_per_rev is not None:
        radius = radius_from_counts_m(car.teeth_per_rev, counted)
        by_size = count_prior(counted, counted_std, tyre, settings).by_size(car.teeth_per_rev, settings)
        return ToothCount(car.teeth_per_rev, 0.0, settings.max_probability, radius, by_size=by_size)
    wheels: list[tuple[Counter, float]] = []
    for one in followers_found:
        field = one.series.field
        log = material.logs[field.key].selected(field.selectors)
        counter = unwrap(field, log, log.bits(field.layout))
        if counter is not None:
            wheels.append((counter, abs(field.scale)))
    return tooth_count(counted, counted_std, tyre, wheels, settings)


def _tyre_size_warning(teeth: ToothCount, tyre: str | None, car: CarPlatform | None) -> tuple[str, ...]:
    """Return one sentence if the counts contradict the tyre's size; else an empty tuple."""
    if teeth.by_size is None or teeth.probability < SETTINGS.decided:
        return ()
    needed, std = teeth.by_size
    known = car is not None and car.teeth_per_rev is not None
    shown = (
        f"the car library has {teeth.value:g}"
        if known
        else f"the ripple of the rings shows {_counts_text(teeth)}"
    )
    return (
        f"the tyre size {tyre} needs {needed:.0f} +- {std:.0f} counts per revolution, {shown}, "
        f"a rolling radius of {teeth.radius_m:.3f} m: the size given is not that of the tyres on this drive",
    )


def _counts_text(teeth: ToothCount) -> str:
    return (
        f"{teeth.value:.1f} +- {teeth.std:.1f}"
        if teeth.value > SETTINGS.max_ring_teeth
        else f"{teeth.value:.0f}"
    )


def _undecided_counts(teeth: ToothCount, tyre: str | None) -> Undecided:
    alternatives = ", ".join(f"{value:g} {p:.2f}" for value, p in teeth.alternatives)
    if teeth.probability > 0.0:
        why = f"{teeth.value:g} {teeth.probability:.2f}" + (f", {alternatives}" if alternatives else "")
        why += ": neither the rolling radius nor the ripple of the rings decides"
    else:
        source = "of all tyres" if tyre is None else f"of the tyre size {tyre}"
        why = f"{teeth.value:.0f} +- {teeth.std:.0f} by the rolling radius {source} alone: no ripple of a "
        why += "revolution stands out"
    size = "give the tyre's size (--tyre 205/55R16), or " if tyre is None else ""
    drive = f"{size}twenty minutes at a steady 50 to 100 km/h; one turn of a wheel counted by hand decides"
    return Undecided("vehicle.teeth_per_rev", why, drive)


def _best_assignment(material: PreparedLog, match: Match | None, settings: Settings) -> Assignment | None:
    """Return the assignment of the best cluster: one with four wheels, counts before speeds, then the most
    probable."""
    reference = material.reference
    found = _disjoint_followers(material, settings)
    ranked = []
    for group in clusters(found, settings):
        if len(group) < 2:
            continue
        late = groups_by_lag(with_positions(group, reference, material.gyro, settings), settings)
        for order, part in enumerate(late):
            if len(part) < 2:
                continue
            members = part if len(late) == 1 else with_positions(part, reference, material.gyro, settings)
            made = assign(members, receiver_position_fit(members, reference, settings), settings, match)
            if made is None:
                continue
            least = min(role.probability for role in made.roles)
            ranked.append(((not made.pair_only, least > 0.5, made.kind == "counts", -order, least), made))
    if not ranked:
        return None
    return max(ranked, key=lambda entry: entry[0])[1]


def _without_wheels(nothing: BusDiscovery, material: PreparedLog, settings: Settings) -> BusDiscovery:
    """Return the discovery of a drive in which no wheels were found: `nothing` with the signals that may be
    one.
    """
    why = "no pair of signals follows the receiver's speed with the difference of two wheels in bends"
    likely = candidates(_disjoint_followers(material, settings), material.reference, settings)
    kind = likely[0].kind if likely else "count"
    undecided = _undecided_wheels(why, "10 min of mixed driving with many bends", kind)
    return replace(nothing, undecided=undecided, candidates=likely)


def _disjoint_followers(material: PreparedLog, settings: Settings) -> list[Follower]:
    """Return the plausible signals that follow the receiver's speed; of readings of raw frames that share
    bits the best one.
    """
    reference = material.reference
    found = [
        one for one in followers(material.series, reference, settings) if _is_plausible_wheel(one, settings)
    ]
    return found if material.has_dbc else _without_overlaps(found)


def _agrees_with_match(assignment: Assignment, match: Match) -> bool:
    """Return whether the drive puts the wheels where the platform has them."""
    found = {role.wheel: role.follower.series.field.signal for role in assignment.roles}
    return all(found.get(wheel) == signal for wheel, signal in match.wheels.items())


def _is_plausible_wheel(one: Follower, settings: Settings) -> bool:
    """Return whether a wheel counts between four and two hundred thousand times a turn, or its speed has
    steps below 1 m/s."""
    if one.series.kind == "count":
        counts_per_rev = one.per_mps * 2 * np.pi * settings.radius_m
        return 4.0 < counts_per_rev < 2e5
    return one.per_mps > 0.9


def _without_overlaps(found: Sequence[Follower]) -> list[Follower]:
    """Return readings that share no bits: of those that do, the one that follows best, then the smoothest and
    widest."""
    kept: list[Follower] = []
    used: dict[int, list[set[int]]] = {}
    for first in sorted(found, key=lambda f: -f.r2):
        others = used.setdefault(first.series.field.key, [])
        if any(_occupied_bits(first.series.field) & other for other in others):
            continue
        equals = [
            one
            for one in found
            if one.series.field.key == first.series.field.key
            and one.series.kind == first.series.kind
            and one.r2 > first.r2 - SETTINGS.equal_r2
            and not any(_occupied_bits(one.series.field) & other for other in others)
        ]
        best = _smoothest(first, equals)
        one, bits = best, _occupied_bits(best.series.field)
        for wider in equals:
            wide = _occupied_bits(wider.series.field)
            order = wider.series.field.layout.big_endian == best.series.field.layout.big_endian
            as_smooth = _step_mps(wider) <= (1.0 + 1e-9) * _step_mps(best)
            if len(wide) > len(bits) and wide > bits and as_smooth and (order or len(bits) <= 8):
                one, bits = wider, wide
        kept.append(one)
        others.append(bits)
    return kept


def _smoothest(first: Follower, equals: Sequence[Follower]) -> Follower:
    """Return the reading with the least steps in m/s among those that share bits with the first one.

    The high byte of one wheel's speed and the low byte of its neighbour's make a number that follows the
    car's speed as well as either wheel: it jumps wherever one of them carries and the other does not yet.
    """
    bits = _occupied_bits(first.series.field)
    alternatives = [one for one in equals if bits & _occupied_bits(one.series.field)]
    return min(alternatives, key=lambda one: (_step_mps(one), -one.r2))


def _step_mps(one: Follower) -> float:
    """Return the root mean square of the steps from frame to frame, m/s; 0 for counters."""
    return one.series.step_rms / one.per_mps


def _occupied_bits(one: MessageField) -> set[int]:
    """Return the positions of a field's bits in the payload."""
    layout = one.layout
    if not layout.big_endian:
        return set(range(layout.shift, layout.shift + layout.length))
    size = 8 * layout.word_bytes
    return {
        8 * (layout.word_bytes - 1 - at // 8) + at % 8
        for at in range(layout.shift, layout.shift + layout.length)
        if at < size
    }


def _wheel_roles(
    assignment: Assignment, undecided: list[Undecided], settings: Settings
) -> dict[str, FoundRole]:
    """Return the wheels' signals by role; those that are not decided are appended to `undecided`."""
    roles = {}
    what = "count" if assignment.kind == "counts" else "speed"
    for role in assignment.roles:
        key = f"wheel_{what}_{role.wheel}"
        one = role.follower.series.field
        roles[key] = (
            _count_role(key, role.follower, role.probability, role.alternatives)
            if what == "count"
            else _speed_role(key, role.follower, role.probability, role.alternatives)
        )
        if role.probability < settings.decided:
            alternatives = (
                ", ".join(f"{name} {p:.2f}" for name, p in role.alternatives) or "none of them a wheel"
            )
            why = f"{one.signal} {role.probability:.2f}, {alternatives}"
            undecided.append(Undecided(f"can.signals.{key}", why, _recommended_manoeuvre(assignment)))
    return roles


def _recommended_manoeuvre(assignment: Assignment) -> str:
    """Return in words the driving that decides the sides, or the axles where those are less sure."""
    if assignment.left_right < assignment.front_rear:
        return "ten bends to either side: the sides do not differ on straight roads"
    return "ten tight bends at walking to town speed: the front wheels' longer way shows there"


def _count_role(
    key: str, one: Follower, probability: float, alternatives: tuple[tuple[str, float], ...]
) -> FoundRole:
    """Return the role of a counter, with its modulus where that is not the field's width."""
    series = one.series
    usual = series.field.stated_modulus or 1 << series.field.layout.length
    modulus = series.modulus if series.modulus_seen and series.modulus != usual else 0
    invalid = tuple(sorted(series.no_value))
    return FoundRole(key, series.field, probability, alternatives, modulus=modulus, invalid=invalid)


def _speed_role(
    key: str, one: Follower, probability: float, alternatives: tuple[tuple[str, float], ...]
) -> FoundRole:
    """Return the role of a speed, with unit and scale checked against the receiver."""
    found = _with_inferred_unit(key, one, probability, alternatives)
    return replace(found, invalid=tuple(sorted(one.series.no_value)))


def _with_inferred_unit(
    key: str, one: Follower, probability: float, alternatives: tuple[tuple[str, float], ...]
) -> FoundRole:
    """Return the role with the unit, scale and offset by which it reads the receiver's speed."""
    known = one.series.field
    declared = canonical_unit(known.unit) or "km/h"
    kind, factor, _ = UNITS[declared]
    mps_per_unit = 1.0 / physical_scale(one)
    if kind == "angular speed":
        radius = mps_per_unit / factor
        fits = 0.2 < radius < 0.6
    else:
        fits = abs(mps_per_unit / factor - 1.0) < SETTINGS.unit_tolerance
    if fits:
        return FoundRole(
            key, known, probability, alternatives, unit=None if canonical_unit(known.unit) else declared
        )
    for unit in _SPEED_UNITS:
        if abs(mps_per_unit / UNITS[unit][1] - 1.0) < SETTINGS.unit_tolerance:
            return FoundRole(key, known, probability, alternatives, unit=unit)
    scale = 3.6 / one.per_mps
    nice = min(_NICE_KMH, key=lambda n: abs(n / scale - 1.0))
    scale = nice if abs(nice / scale - 1.0) < 0.04 else float(f"{scale:.6g}")
    base = 0.0 if abs(one.base) < 3.0 else -scale * round(one.base)
    return FoundRole(key, known, probability, alternatives, unit="km/h", scale=scale, offset=base)


def _undecided_wheels(why: str, drive: str, kind: str = "count") -> tuple[Undecided, ...]:
    return (Undecided(f"can.signals.wheel_{kind}_rl", why, drive),)


def _undecided_measures(
    geometry: Mapping[str, Estimate], gnss: Mapping[str, Estimate], assignment: Assignment
) -> list[Undecided]:
    """Return an entry for each track, wheelbase or antenna coordinate that is not known well enough."""
    wanted = ["track_rear_m"] + ([] if assignment.pair_only else ["track_front_m", "wheelbase_m"])
    bends = "ten bends to either side, some of them tight"
    lines = [
        Undecided(f"vehicle.{key}", "too little turning; a usual value is written", bends)
        for key in wanted
        if key not in geometry
    ]
    lines += [
        Undecided(f"gnss.{key}", f"known to {gnss[key].std:.1f} m only" if key in gnss else "not seen", bends)
        for key in ("antenna_forward_m", "antenna_left_m")
        if key not in gnss or gnss[key].std > 0.5
    ]
    return lines
