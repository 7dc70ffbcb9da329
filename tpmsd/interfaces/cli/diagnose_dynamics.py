"""`tpmsd diagnose DRIVE --baseline single-track | three-dof`: what a model of vehicle dynamics leaves out.

In: a drive folder with a table of signals and the tables `[vehicle]` and `[dynamics]`. Out: a summary in
sentences, JSON, a page, a picture, the extended model, the file of a proposed effect.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.foundation.errors import ConfigError, InputError, TpmsdError
from tpmsd.interfaces.cli.output import Progress, json_text
from tpmsd.interfaces.cli.output_files import Outputs, say_verdict

if TYPE_CHECKING:
    from tpmsd.car.physics.baselines.base import Baseline
    from tpmsd.car.physics.dynamics_effect import DynamicsEffect
    from tpmsd.foundation.wheels import FloatArray
    from tpmsd.offline.dynamics.drive import DynamicsDrive
    from tpmsd.offline.dynamics.result import DynamicsDiagnosis

SCHEMA = "tpmsd.diagnosis/2"
CERTIFY_SEED = 0
"""Seed of the replicates: the same drive gets the same certificate."""


def run_dynamics(args: argparse.Namespace) -> int:
    """Run `tpmsd diagnose` with a baseline of vehicle dynamics; return the exit code."""
    import numpy as np

    from tpmsd.car.physics.dynamics_model import DynamicsModel, belongs_to_one_drive, format_dynamics_model
    from tpmsd.foundation.provenance import provenance
    from tpmsd.offline.dynamics.certify import Replicates
    from tpmsd.offline.dynamics.diagnose import diagnose_dynamics, effects_of_simulation
    from tpmsd.offline.dynamics.document import dynamics_document
    from tpmsd.offline.dynamics.result import INSUFFICIENT
    from tpmsd.offline.dynamics.simulate import against_simulation, as_recorded
    from tpmsd.offline.dynamics.summary import dynamics_summary

    files = (("--model-out", args.model_out), ("--html", args.html), ("--plot", args.plot))
    outputs = Outputs(*files, ("--json", args.json))
    _check_options(args)
    folder = args.drives[0]
    baseline, drive = read_dynamics_drive(folder, args.config, args.baseline)
    given = model_effects(args.model, drive.key)
    simulation = None if args.simulation is None else _simulated_outputs(args.simulation, drive, folder)
    replicates = Replicates(args.certify or 0, np.random.default_rng(CERTIFY_SEED))
    with Progress(1.0, "diagnose") as progress:
        try:
            simulated = None
            if simulation is not None:
                like = as_recorded(drive, simulation, np.random.default_rng(CERTIFY_SEED))
                simulated = effects_of_simulation(baseline, like, partial(_update_part, progress, 0.0, 0.4))
                drive = against_simulation(baseline, drive, simulation, simulated)
            say = progress.update if simulated is None else partial(_update_part, progress, 0.4, 1.0)
            diagnosis = diagnose_dynamics(
                baseline, drive, given, say, replicates, args.propose is not None, simulated
            )
        except np.linalg.LinAlgError as error:
            raise InputError(folder, f"no path of a car is determined by its signals ({error})") from None
    known = diagnosis.verdict != INSUFFICIENT
    model_file = str(args.model_out) if known and args.model_out is not None else None
    keys = tuple(drive.key if belongs_to_one_drive(effect) else "" for effect in diagnosis.effects)
    model = DynamicsModel(diagnosis.effects, diagnosis.stds, keys)
    origin = cache(lambda: provenance(SCHEMA, args.drives, args.config or folder))
    reason = None if known else diagnosis.reason
    code = say_verdict(reason, lambda: dynamics_summary(diagnosis, model_file), outputs)
    comment = f"written by tpmsd diagnose --baseline {args.baseline} from {folder.resolve().name}"
    outputs.write(
        {
            "--model-out": lambda: format_dynamics_model(model, comment) if known else None,
            "--plot": lambda: _picture(diagnosis, drive.name, args.plot.suffix),
            "--html": lambda: _page(diagnosis, drive.name, origin()),
            "--json": lambda: json_text({**origin(), **dynamics_document(diagnosis, model_file)}),
        }
    )
    if args.propose is not None and known:
        _write_proposal(args.propose, diagnosis, drive.name)
    return code


def _update_part(progress: Progress, first: float, last: float, share: float) -> None:
    """Show the progress `share` of a part of the work that goes from `first` to `last`."""
    progress.update(first + (last - first) * share)


def _picture(diagnosis: DynamicsDiagnosis, name: str, suffix: str) -> bytes:
    """Return the diagnosis as a picture of the form `suffix`."""
    from tpmsd.offline.report.dynamics_plot import plot_dynamics

    return plot_dynamics(diagnosis, name, suffix)


def _page(diagnosis: DynamicsDiagnosis, name: str, origin: Mapping[str, Any]) -> str:
    """Return the diagnosis as an HTML page."""
    from tpmsd.offline.report.dynamics_page import dynamics_page
    from tpmsd.offline.report.page import Origin

    return dynamics_page(diagnosis, name, Origin.now(origin))


def _check_options(args: argparse.Namespace) -> None:
    """Raise ConfigError on options that do not go together or lack a package, before anything is read."""
    from tpmsd.offline.report.page import check_report_packages
    from tpmsd.offline.report.replay_plot import check_plot_target

    if len(args.drives) > 1:
        raise ConfigError(f"--baseline {args.baseline} takes one DRIVE")
    if args.alarms:
        raise ConfigError(f"--alarms is not there for --baseline {args.baseline}")
    if args.plot is not None:
        check_plot_target(args.plot)
    if args.html is not None:
        check_report_packages()
    if args.propose is not None and args.propose.is_file():
        raise ConfigError(f"--propose: {args.propose} is a file")


def _write_proposal(folder: Path, diagnosis: DynamicsDiagnosis, source: str) -> None:
    """Write the module that defines the best closed form as an effect; TpmsdError if it cannot be written."""
    from tpmsd.offline.dynamics.proposals import dynamics_effect_file

    if not diagnosis.proposals:
        print("tpmsd: nothing to propose: all that was found has a name", file=sys.stderr)
        return
    name, text = dynamics_effect_file(diagnosis.proposals[0], source)
    path = folder / f"{name}.py"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise TpmsdError(f"{path}: cannot be written: {error.strerror}") from None
    print(f"tpmsd: proposed {path}: review it, then name its folder with --effects-path", file=sys.stderr)


def _simulated_outputs(simulation: Path, drive: DynamicsDrive, recording: Path) -> dict[str, FloatArray]:
    """Return the outputs of a user's simulation of the drive, (n,) each; InputError if none is usable."""
    from tpmsd.offline.signals.fmu import fmu_table
    from tpmsd.offline.signals.read import read_signals
    from tpmsd.offline.signals.simulation import outputs_of_simulation

    is_fmu = simulation.suffix.lower() == ".fmu"
    table = fmu_table(simulation, recording, drive) if is_fmu else read_signals(simulation)
    return outputs_of_simulation(table, drive)


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
    """Return the effects of a model file that hold on the drive with this key; others are named on standard
    error."""
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
