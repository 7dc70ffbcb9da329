"""Drives of the independent world for tests: made once per process, as arrays and as folders."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from bench.worlds.lively_car import CarSpec, Concealed, SensorSpec, drive, vehicle_tables
from tpmsd.car.config.dynamics import load_car
from tpmsd.car.physics.baselines.base import Baseline
from tpmsd.offline.dynamics.diagnose import diagnose_dynamics
from tpmsd.offline.dynamics.drive import DynamicsDrive
from tpmsd.offline.dynamics.result import DynamicsDiagnosis
from tpmsd.offline.signals.drive import make_drive
from tpmsd.offline.signals.read import read_signals
from tpmsd.offline.signals.write import signals_text

Hidden = tuple[tuple[str, tuple[tuple[str, float], ...]], ...]


def hidden(**effects: dict[str, float]) -> Hidden:
    """Return what is concealed in a form that can be cached."""
    return tuple((name, tuple(sorted(values.items()))) for name, values in sorted(effects.items()))


def folder(
    where: Path,
    concealed: Hidden = (),
    model: str = "single-track",
    duration_s: float = 60.0,
    seed: int = 1,
    forces: bool = False,
    sensors: SensorSpec | None = None,
) -> Path:
    """Write a drive folder."""
    where.mkdir(parents=True, exist_ok=True)
    spec = CarSpec()
    made = drive(
        spec,
        Concealed({name: dict(values) for name, values in concealed}),
        np.random.default_rng(seed),
        model,
        duration_s,
        sensors,
        forces,
    )
    (where / "signals.csv").write_text(signals_text(made.columns), encoding="utf-8")
    (where / "vehicle.toml").write_text(vehicle_tables(spec), encoding="utf-8")
    return where


def loaded(where: Path, baseline: str) -> tuple[Baseline, DynamicsDrive]:
    """Return baseline and drive of a folder."""
    return make_drive(read_signals(where), load_car(where), baseline, where.name)


_FOLDERS: dict[str, Path] = {}


@cache
def diagnosed(
    root: str,
    concealed: Hidden,
    model: str = "single-track",
    duration_s: float = 60.0,
    seed: int = 1,
    forces: bool = False,
) -> DynamicsDiagnosis:
    """Return the diagnosis of a world of a model with that baseline."""
    name = f"{model}-{forces}-{seed}-{duration_s:g}-{abs(hash(concealed))}"
    where = folder(Path(root) / name, concealed, model, duration_s, seed, forces)
    return diagnose_dynamics(*loaded(where, model))
