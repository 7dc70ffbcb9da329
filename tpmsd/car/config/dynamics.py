"""The table `[dynamics]` of a configuration: masses, lengths and stiffnesses for the baselines of vehicle
dynamics.

In: the folder or file of a configuration. Out: `DynamicsConfig` in a `Config`, or `load_car`, which reads
`[vehicle]` and `[dynamics]` alone, so that a folder without a bus needs no DBC.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tpmsd.car.config.document import Document, read_document
from tpmsd.car.config.dynamics_record import DynamicsConfig
from tpmsd.car.config.problems import BadValueError, ConfigProblems, Problem
from tpmsd.car.config.rules import Choice, Number, Rule
from tpmsd.car.config.suggest import nearest

RADIUS = Number(0.15, 0.7, "m")
"""Nominal radius of a wheel: go-kart to lorry."""
_STIFFNESS = Number(1e3, 2e6, "N/rad")

RULES: dict[str, Rule] = {
    "mass_kg": Number(50.0, 60_000.0, "kg"),
    "yaw_inertia_kgm2": Number(5.0, 1e6, "kg m2"),
    "cg_to_front_m": Number(0.1, 8.0, "m"),
    "cg_to_rear_m": Number(0.1, 8.0, "m"),
    "cg_height_m": Number(0.05, 3.0, "m"),
    "cornering_stiffness_front_n_per_rad": _STIFFNESS,
    "cornering_stiffness_rear_n_per_rad": _STIFFNESS,
    "longitudinal_stiffness_n": Number(1e3, 2e6, "N"),
    "friction": Number(0.05, 3.0),
    "brake_front_share": Number(0.0, 1.0, "share"),
    "drag_area_m2": Number(0.0, 20.0, "m2"),
    "rolling_resistance": Number(0.0, 0.2),
}
"""Keys of the table."""
NEEDED = (
    "mass_kg",
    "yaw_inertia_kgm2",
    "cg_to_front_m",
    "cg_to_rear_m",
    "cornering_stiffness_front_n_per_rad",
    "cornering_stiffness_rear_n_per_rad",
)
"""Keys without which there is no baseline of vehicle dynamics."""


@dataclass(frozen=True, slots=True)
class CarTables:
    """Masses, geometry and tyres of a car, from `[vehicle]` and `[dynamics]`, for the dynamics baselines."""

    file: Path
    dynamics: DynamicsConfig
    track_front_m: float
    track_rear_m: float
    driven_axle: str
    steering_ratio: float | None
    wheel_radius_m: float


_VEHICLE: dict[str, Rule] = {
    "track_front_m": Number(0.8, 3.0, "m"),
    "track_rear_m": Number(0.8, 3.0, "m"),
    "driven_axle": Choice(("front", "rear", "all")),
    "steering_ratio": Number(1.0, 60.0),
}


def load_car(path: Path) -> CarTables:
    """Return the car in the file `path` or in the `vehicle.toml` of the folder; ConfigProblems if it has
    none."""
    document = read_document(path)
    problems: list[Problem] = []
    dynamics = _read_table(document, "dynamics", RULES, problems)
    given = document.data.get("vehicle")
    known = {key: given[key] for key in _VEHICLE if key in given} if isinstance(given, dict) else {}
    vehicle = _good_values(document, "vehicle", known, _VEHICLE, problems)
    radius_m = _nominal_radius_m(document, given, problems)
    for key in NEEDED:
        if key not in dynamics:
            found = document.data.get("dynamics")
            if not (isinstance(found, dict) and key in found):
                bad = BadValueError("missing", allowed="a baseline of vehicle dynamics needs it")
                problems.append(bad.at(document.file, document.line("dynamics"), f"[dynamics] {key}"))
    if problems:
        raise ConfigProblems(tuple(problems))
    base = dynamics["cg_to_front_m"] + dynamics["cg_to_rear_m"]
    return CarTables(
        document.file,
        DynamicsConfig(**dynamics),
        vehicle.get("track_front_m", 0.57 * base),
        vehicle.get("track_rear_m", 0.57 * base),
        vehicle.get("driven_axle", "front"),
        vehicle.get("steering_ratio"),
        radius_m,
    )


def _nominal_radius_m(document: Document, vehicle: object, problems: list[Problem]) -> float:
    """Return the nominal radius in metres, the mean where wheels differ; 0.3 m where none is stated."""
    value = vehicle.get("wheel_radius_m") if isinstance(vehicle, dict) else None
    wheels = value if isinstance(value, dict) else {} if value is None else {"all": value}
    rules: dict[str, Rule] = dict.fromkeys(wheels, RADIUS)
    read = _good_values(document, "vehicle", wheels, rules, problems, "wheel_radius_m")
    return sum(read.values()) / len(read) if read else 0.3


def _read_table(
    document: Document, table: str, rules: Mapping[str, Rule], problems: list[Problem]
) -> dict[str, Any]:
    """Return the valid values of a table by key; add what is wrong to the problems."""
    given = document.data.get(table, {})
    if not isinstance(given, dict):
        bad = BadValueError("must be a table", allowed=f"[{table}] on a line of its own")
        problems.append(bad.at(document.file, document.line(table), f"[{table}]"))
        return {}
    for key in given:
        if key not in rules:
            unknown = BadValueError("unknown key", allowed=" ".join(rules), suggestion=nearest(key, rules))
            problems.append(unknown.at(document.file, document.line(table, key), f"[{table}] {key}"))
    return _good_values(document, table, {k: v for k, v in given.items() if k in rules}, rules, problems)


def _good_values(
    document: Document,
    table: str,
    given: Mapping[str, Any],
    rules: Mapping[str, Rule],
    problems: list[Problem],
    within: str | None = None,
) -> dict[str, Any]:
    """Return the valid values by key; add others to the problems, at their key or at the key `within`."""
    good: dict[str, Any] = {}
    for key, value in given.items():
        try:
            good[key] = rules[key].read(value)
        except BadValueError as bad:
            at = within or key
            problems.append(bad.at(document.file, document.line(table, at), f"[{table}] {at}"))
    return good
