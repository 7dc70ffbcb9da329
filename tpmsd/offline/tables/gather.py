"""Conversion of series by role to a car's signals.

In: role -> `SignalReadings` in SI units, the nominal radii. Out: `Signals`. Pure.

Wheel speeds become angles by the trapezoidal rule; counts that roll over are unwrapped by their modulus;
positions in a simulator's plane are laid on the ellipsoid so that lengths and angles along the path stay.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tpmsd.car.config.model import OPTIONAL_ROLES
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.tables.roles import ANGLE_ROLES, COUNT_ROLES, SPEED_ROLES, STD_ROLES
from tpmsd.offline.tables.signals import Fixes, SignalReadings, Signals

ORIGIN_DEG = (50.0, 8.0)
"""Latitude and longitude at which the plane of a simulator touches the earth; any point will do."""
WGS84_A_M, WGS84_E2 = 6_378_137.0, 0.0066943799901413165
FINEST_RAD = 2.0e-5
"""Resolution of an angle below which it is taken for exact (6 um of road), rad."""
PLANE_STD_M = 1.0
"""Standard deviation of positions of which the table says nothing."""


class TableError(ConfigError):
    """Readings that cannot be used, whatever the columns are said to be."""


def split_empty(series: Mapping[str, SignalReadings]) -> tuple[dict[str, SignalReadings], list[str]]:
    """Return the series without wheels and inertial signals that hold no reading at all, and the roles of
    those.

    A tick table has every column, also those of signals that the car does not send. What a receiver left
    empty stays: an empty accuracy means that it stated none.
    """
    optional = {*ANGLE_ROLES, *SPEED_ROLES, *COUNT_ROLES, *OPTIONAL_ROLES}
    empty = [role for role, one in series.items() if role in optional and not len(one.finite().time_s)]
    return {role: one for role, one in series.items() if role not in empty}, empty


def signals_from(series: Mapping[str, SignalReadings], modulus: Mapping[str, int] | None = None) -> Signals:
    """Return the signals of the series; `modulus`: the number of values of a wheel's count, by role.

    ConfigError where wheels are missing, or given in two ways.
    """
    kind, wheels = _wheel_readings(series)
    for wheel, one in wheels.items():
        _check_times(one, f"wheel {wheel}")
    angles: dict[str, SignalReadings] = {}
    counts: dict[str, SignalReadings] = {}
    if kind == "angles":
        angles = wheels
    elif kind == "speeds":
        angles = {wheel: _integrate(one) for wheel, one in wheels.items()}
    else:
        moduli = modulus or {}
        counts = {
            wheel: _unwrap_counts(one, moduli.get(f"wheel_count_{wheel}")) for wheel, one in wheels.items()
        }
    inertial = {role: series[role] for role in OPTIONAL_ROLES if role in series}
    for role, one in inertial.items():
        _check_times(one, role)
    return Signals(angles, counts, _counts_per_revolution(series), inertial, _fixes_of(series))


def _wheel_readings(series: Mapping[str, SignalReadings]) -> tuple[str, dict[str, SignalReadings]]:
    """Return how wheels are given (angles, speeds, counts) and their readings; ConfigError where they are
    given in no way or in two, or one of a pair is missing.
    """
    kinds = {
        "angles": {wheel: series[role] for wheel, role in _present_roles(ANGLE_ROLES, series)},
        "speeds": {wheel: series[role] for wheel, role in _present_roles(SPEED_ROLES, series)},
        "counts": {wheel: series[role] for wheel, role in _present_roles(COUNT_ROLES, series)},
    }
    found = [kind for kind, wheels in kinds.items() if wheels]
    if not found:
        raise ConfigError("no wheel: give wheel_angle_*, wheel_speed_* or wheel_count_* of the wheels")
    if len(found) > 1:
        raise ConfigError(f"wheels are given as {' and as '.join(found)}; one of them, please")
    wheels = kinds[found[0]]
    missing = [wheel for wheel in ("rl", "rr") if wheel not in wheels]
    if ("fl" in wheels) != ("fr" in wheels):
        missing.append("fr" if "fl" in wheels else "fl")
    if missing:
        raise ConfigError(f"no wheel_*_{missing[0]}: all four wheels are needed, or the rear pair")
    return found[0], wheels


def _counts_per_revolution(series: Mapping[str, SignalReadings]) -> float | None:
    """Return the counts per revolution by the rotations' standard deviations, each quantum / sqrt(6); None
    where there is none."""
    stds = [series[role].finite().value for role in STD_ROLES if role in series]
    std = float(np.median(np.concatenate(stds))) if stds and sum(map(len, stds)) else 0.0
    return None if std < FINEST_RAD else round(2.0 * np.pi / (std * np.sqrt(6.0)), 6)


def _present_roles(roles: tuple[str, ...], series: Mapping[str, SignalReadings]) -> list[tuple[str, str]]:
    """Return (wheel, role) of the roles that have readings."""
    return [(wheel, role) for wheel, role in zip(WHEELS, roles, strict=True) if role in series]


def _check_times(series: SignalReadings, name: str) -> None:
    """Raise TableError for fewer than two readings or times that do not rise."""
    times = series.finite().time_s
    if len(times) < 2:
        raise TableError(f"{name}: fewer than two readings")
    if not bool(np.all(np.diff(times) > 0)):
        at = int(np.flatnonzero(np.diff(times) <= 0)[0])
        raise TableError(f"{name}: time does not rise at {times[at + 1]:.6f} s")


def _integrate(series: SignalReadings) -> SignalReadings:
    known = series.finite()
    steps = np.diff(known.time_s) * 0.5 * (known.value[1:] + known.value[:-1])
    return SignalReadings(known.time_s, np.concatenate([[0.0], np.cumsum(steps)]))


def _unwrap_counts(series: SignalReadings, modulus: int | None) -> SignalReadings:
    if modulus is None:
        return series
    known = series.finite()
    steps = np.diff(known.value)
    steps = steps - modulus * np.round(steps / modulus)
    return SignalReadings(known.time_s, known.value[0] + np.concatenate([[0.0], np.cumsum(steps)]))


def _fixes_of(series: Mapping[str, SignalReadings]) -> Fixes | None:
    """Return the fixes: rows in which the receiver stated a position or a speed; None without columns of a
    receiver.
    """
    receiver = {role: one for role, one in series.items() if role.startswith("gnss_")}
    anchor = next((receiver[r] for r in ("gnss_latitude", "gnss_east", "gnss_speed") if r in receiver), None)
    if anchor is None:
        if receiver:
            raise ConfigError(
                f"{', '.join(sorted(receiver))}: without latitude and longitude, or east and north"
            )
        return None
    for one, other in (("gnss_latitude", "gnss_longitude"), ("gnss_east", "gnss_north")):
        if (one in receiver) != (other in receiver):
            raise ConfigError(f"{one} and {other} go together")
    known = np.isfinite(anchor.value) & np.isfinite(anchor.time_s)
    time_s = anchor.time_s[known]
    columns = {role: _values_at_fixes(one, time_s) for role, one in receiver.items()}
    nothing = np.full(len(time_s), np.nan)
    latitude, longitude = columns.get("gnss_latitude", nothing), columns.get("gnss_longitude", nothing)
    course = columns.get("gnss_course", nothing)
    turned = np.zeros(len(time_s))
    if "gnss_east" in columns:
        latitude, longitude, turned = geodetic_from_plane(
            columns["gnss_east"], columns["gnss_north"], columns.get("gnss_altitude", nothing)
        )
    if "gnss_heading" in columns:
        course = np.mod(np.pi / 2 - columns["gnss_heading"] - turned, 2 * np.pi)
    arrival = columns.get("gnss_arrival", time_s)
    std = columns.get("gnss_position_std", nothing)
    if "gnss_hdop" not in columns and "gnss_position_std" not in columns:
        std = np.full(len(time_s), PLANE_STD_M)
    order = np.argsort(arrival, kind="stable")
    table = (
        *(arrival, columns.get("gnss_utc", arrival), latitude, longitude),
        *(columns.get("gnss_altitude", nothing), std, columns.get("gnss_speed", nothing), course),
        *(columns.get("gnss_quality", nothing), columns.get("gnss_hdop", nothing)),
    )
    return Fixes(*(np.asarray(column[order], dtype=np.float64) for column in table))


def _values_at_fixes(series: SignalReadings, time_s: FloatArray) -> FloatArray:
    """Return the (n,) values at the fixes' times: the reading of that very time, else the last before it; NaN
    before the first.
    """
    if len(series.time_s) == len(time_s) and np.array_equal(series.time_s, time_s):
        return series.value
    at = np.searchsorted(series.time_s, time_s, side="right") - 1
    return np.where(at >= 0, series.value[np.maximum(at, 0)], np.nan)


def geodetic_from_plane(
    east_m: FloatArray, north_m: FloatArray, height_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the (n,) latitude and longitude (deg) of a path in a plane, and the rotation (rad) of true east
    against its east axis.

    The plane rolls over the ellipsoid with the car: a straight line becomes a geodesic, along which true
    north turns by -d_east * tan(latitude) / N. Fixed-point iteration, five digits per round below 100 km.
    """
    if not len(east_m):
        return east_m, north_m, np.zeros(0)
    height = np.where(np.isfinite(height_m), height_m, 0.0)
    steps = np.diff(east_m) + 1j * np.diff(north_m)
    lat = np.full(len(east_m), np.radians(ORIGIN_DEG[0]))
    turned = np.zeros(len(east_m))
    for _ in range(5):
        middle, up = 0.5 * (lat[1:] + lat[:-1]), 0.5 * (height[1:] + height[:-1])
        w2 = 1.0 - WGS84_E2 * np.sin(middle) ** 2
        meridian, prime = WGS84_A_M * (1 - WGS84_E2) / w2**1.5 + up, WGS84_A_M / np.sqrt(w2) + up
        true = steps * np.exp(0.5j * (turned[1:] + turned[:-1]))
        lat = lat[0] + np.concatenate([[0.0], np.cumsum(true.imag / meridian)])
        turned = -np.concatenate([[0.0], np.cumsum(true.real * np.tan(middle) / prime)])
    lon = np.concatenate([[0.0], np.cumsum(true.real / (prime * np.cos(middle)))])
    return np.degrees(lat), ORIGIN_DEG[1] + np.degrees(lon), turned
