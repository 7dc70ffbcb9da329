"""`tpmsd diagnose DRIVE --baseline single-track | three-dof`: what a model of vehicle dynamics leaves out.

In: a drive folder with a table of signals and the tables `[vehicle]` and `[dynamics]`. Out: a summary in
sentences, JSON, the extended model.
"""

from __future__ import annotations

import argparse
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.interfaces.cli.output import Progress, json_text
from tpmsd.interfaces.cli.outputs import Outputs, say_verdict

if TYPE_CHECKING:
    from tpmsd.car.physics.baselines.base import Baseline
    from tpmsd.car.physics.dynamics_effect import DynamicsEffect
    from tpmsd.offline.dynamics.drive import DynamicsDrive

SCHEMA = "tpmsd.diagnosis/2"


def run_dynamics(args: argparse.Namespace) -> int:
    """Diagnose one drive with a baseline of vehicle dynamics."""
    from tpmsd.car.physics.dynamics_model import DynamicsModel, bound_to_time, format_dynamics_model
    from tpmsd.foundation.provenance import provenance
    from tpmsd.offline.dynamics.diagnose import diagnose_dynamics
    from tpmsd.offline.dynamics.document import dynamics_document
    from tpmsd.offline.dynamics.result import INSUFFICIENT
    from tpmsd.offline.dynamics.summary import dynamics_summary

    outputs = Outputs(("--model-out", args.model_out), ("--json", args.json))
    _refuse(args)
    folder = args.drives[0]
    baseline, drive = read_dynamics_drive(folder, args.config, args.baseline)
    given = model_effects(args.model, drive.key)
    if args.simulation is not None:
        drive = _against(args.simulation, baseline, drive, folder)
    with Progress(1.0, "diagnose") as progress:
        diagnosis = diagnose_dynamics(baseline, drive, given, progress.update)
    known = diagnosis.verdict != INSUFFICIENT
    model_file = str(args.model_out) if known and args.model_out is not None else None
    keys = tuple(drive.key if bound_to_time(effect) else "" for effect in diagnosis.effects)
    model = DynamicsModel(diagnosis.effects, diagnosis.stds, keys)
    origin = cache(lambda: provenance(SCHEMA, args.drives, args.config or folder))
    reason = None if known else diagnosis.reason
    code = say_verdict(reason, lambda: dynamics_summary(diagnosis, model_file), outputs)
    comment = f"written by tpmsd diagnose --baseline {args.baseline} from {folder.resolve().name}"
    outputs.write(
        {
            "--model-out": lambda: format_dynamics_model(model, comment) if known else None,
            "--json": lambda: json_text({**origin(), **dynamics_document(diagnosis, model_file)}),
        }
    )
    return code


def _refuse(args: argparse.Namespace) -> None:
    """ConfigError on options that belong to the rolling baseline."""
    if len(args.drives) > 1:
        raise ConfigError(f"--baseline {args.baseline} takes one DRIVE")
    for option in ("html", "propose", "alarms"):
        if getattr(args, option):
            raise ConfigError(f"--{option} is not there for --baseline {args.baseline}")


def _against(simulation: Path, baseline: Baseline, drive: DynamicsDrive, recording: Path) -> DynamicsDrive:
    """Return the drive against a user's simulation of it; InputError if that has no usable output."""
    import numpy as np

    from tpmsd.offline.dynamics.simulate import against_simulation
    from tpmsd.offline.signals.columns import OUTPUTS
    from tpmsd.offline.signals.fmu import fmu_table
    from tpmsd.offline.signals.read import read_signals

    is_fmu = simulation.suffix.lower() == ".fmu"
    table = fmu_table(simulation, recording, drive) if is_fmu else read_signals(simulation)
    at = drive.time_s + drive.start_s
    known = {}
    for name, column in OUTPUTS.items():
        values = table.columns.get(column)
        if values is not None and np.isfinite(values).sum() >= 10:
            good = np.isfinite(values)
            known[name] = np.interp(at, table.time_s[good], values[good])
    if table.time_s[0] > at[0] + 1.0 or table.time_s[-1] < at[-1] - 1.0:
        raise InputError(table.file, "does not cover the time of the recording")
    compared = against_simulation(baseline, drive, known)
    if not compared.outputs:
        raise InputError(table.file, f"has none of the outputs {' '.join(drive.outputs)}", 1)
    return compared


def read_dynamics_drive(folder: Path, config: Path | None, baseline: str) -> tuple[Baseline, DynamicsDrive]:
    """Return baseline and drive of a folder; InputError or ConfigError if there is no such one."""
    from tpmsd.car.config.dynamics import load_car
    from tpmsd.offline.signals.drive import make_drive
    from tpmsd.offline.signals.read import read_signals

    if not folder.is_dir():
        raise InputError(folder, "not a folder" if folder.exists() else "no such drive folder")
    tables = load_car(config if config is not None else folder)
    table = read_signals(folder)
    if table.unknown:
        print(
            f"tpmsd: {table.file}: unknown columns left out: {' '.join(table.unknown)[:200]}", file=sys.stderr
        )
    return make_drive(table, tables, baseline, folder.resolve().name)


def model_effects(path: Path | None, key: str) -> tuple[DynamicsEffect, ...]:
    """Return the effects of a model file that hold on the drive with this key; others are named and left
    out."""
    from tpmsd.car.physics.dynamics_model import parse_dynamics_model
    from tpmsd.foundation.text_file import read_text

    if path is None:
        return ()
    text = read_text(path, 1 << 20, "a model")
    try:
        model = parse_dynamics_model(text)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    kept = []
    for effect, drive in zip(model.effects, model.drives, strict=True):
        if drive and drive != key:
            print(
                f"tpmsd: {path}: {effect.name} belongs to the time of another drive: left out",
                file=sys.stderr,
            )
        else:
            kept.append(effect)
    return tuple(kept)
