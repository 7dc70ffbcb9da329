"""`tpmsd diagnose DRIVE...`: which physics a recorded drive holds that the rolling model leaves out.

In: drive folders. Out: a summary in plain sentences, JSON, a page with pictures, and the extended model;
progress on standard error.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import os
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.car.physics.baselines.names import BASELINE_NAMES, ROLLING
from tpmsd.foundation.errors import ConfigError, InputError, TpmsdError
from tpmsd.foundation.startup import keep_freed_memory
from tpmsd.interfaces.cli.output import Progress, Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs, say_verdict

if TYPE_CHECKING:
    from tpmsd.car.physics.model import ExtendedModel
    from tpmsd.offline.diagnosis.assessment.result import Proposal
    from tpmsd.offline.inference.recording import Recording

SCHEMA = "tpmsd.diagnosis/2"
_DESCRIPTION = """\
Compares a recorded drive with the pure rolling model, finds where the two differ, names the physics that was
left out, fits it, and shows on held-out stretches of the drive that the fit holds.

DRIVE is a folder with vehicle.toml, bus.dbc, can.log (or .log.gz .asc .blf .trc .mf4) and gnss.nmea.
"""
_EPILOG = """\
examples:
  tpmsd diagnose drives/monday
  tpmsd diagnose drives/monday --certify 0                 sooner, without p-values
  tpmsd diagnose drives/monday --json monday.json --html monday.html --plot monday.png
  tpmsd diagnose drives/monday --model-out model.toml
  tpmsd diagnose drives/friday --model model.toml          what is left beside what is known
  tpmsd diagnose drives/monday drives/tuesday              one car, fitted together
  tpmsd diagnose drives/monday --simulation sims/monday    what your own simulator leaves out
  tpmsd diagnose drives/monday --alarms                    and what it means for the tyres
  tpmsd simulate drives/again --model model.toml           a drive that holds what was found
  tpmsd diagnose drives/track --baseline three-dof --html track.html --certify 19

Nothing is written but what was asked for: --model-out for the extended model, --json, --html, --plot.
"""

REPLICATES = 19
"""Replicates of the certificate at most: seven do where a finding is beyond doubt, which costs about as much
as the diagnosis itself.
"""
CERTIFY_SEED = 0
"""Seed of the replicates: the same drives get the same certificate."""


def add_parser(subparsers: Subparsers) -> None:
    """Add `diagnose` to the command line."""
    parser = subparsers.add_parser(
        "diagnose",
        help="say which physics a recorded drive holds that the model lacks",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "drives", type=Path, metavar="DRIVE", nargs="+", help="drive folder; several of one car together"
    )
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="configuration instead of DRIVE/vehicle.toml"
    )
    parser.add_argument(
        "--simulation",
        type=Path,
        metavar="SIM_DRIVE",
        help="drive folder that your own simulator wrote of the same drive: say what it lacks,"
        " not what the rolling model lacks; with --baseline single-track or three-dof also an FMU (.fmu),"
        " run on the recording's inputs",
    )
    parser.add_argument(
        "--certify",
        type=_replicates_argument,
        metavar="N",
        help="give each finding a p-value from at most N replicates of the drive, drawn without it; what is"
        f" not sure enough is a suspicion and makes no mismatch (default: {REPLICATES}, and 0 with a baseline"
        " of vehicle dynamics; 0 skips it; with --simulation of the rolling baseline there are none)",
    )
    parser.add_argument(
        "--baseline",
        choices=BASELINE_NAMES,
        default=ROLLING,
        help="model that the drive is compared with (default: rolling): single-track and three-dof are models"
        " of vehicle dynamics and take signals.csv and the table [dynamics]",
    )
    parser.add_argument(
        "--model",
        type=Path,
        metavar="FILE",
        help="effects of a model.toml that belong to the baseline: what they explain is no finding"
        " (default: [filter] model of the configuration)",
    )
    parser.add_argument("--model-out", type=Path, metavar="FILE", help="where the extended model goes")
    parser.add_argument(
        "--propose",
        type=Path,
        metavar="DIR",
        help="where something has no name, write the best closed form for it as a file of the catalogue",
    )
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a page with pictures")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write one picture (.png .svg .pdf)")
    parser.add_argument(
        "--alarms",
        action="store_true",
        help="also say what it means for the tyres: alarms and radii without and with the model"
        " (takes two replays of each drive)",
    )
    add_json_option(parser)


def _replicates_argument(text: str) -> int:
    """Return the number of replicates that an argument states; ArgumentTypeError if it is none."""
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is no number of replicates (0 or more)")
    return int(text)


def _max_replicates(given: int | None) -> int:
    """Return the given number of replicates, or the default for the rolling baseline."""
    return REPLICATES if given is None else given


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd diagnose`; return the exit code."""
    # Thousands of small matrices: threads of the linear algebra only get in each other's way.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    keep_freed_memory()
    if args.baseline != ROLLING:
        from tpmsd.interfaces.cli.diagnose_dynamics import run_dynamics

        return run_dynamics(args)
    return _run_rolling(args)


def _run_rolling(args: argparse.Namespace) -> int:
    """Diagnose against the rolling model, or against a simulation of the user's own."""
    import numpy as np

    from tpmsd.car.physics.model_file import format_model
    from tpmsd.foundation.provenance import provenance
    from tpmsd.interfaces.cli.diagnose_alarms import AlarmReplays
    from tpmsd.offline.diagnosis.assessment.result import INSUFFICIENT
    from tpmsd.offline.diagnosis.diagnose import Certification, diagnose, diagnose_against
    from tpmsd.offline.report.diagnosis_document import diagnosis_document
    from tpmsd.offline.report.diagnosis_page import diagnosis_page
    from tpmsd.offline.report.diagnosis_plot import plot_diagnosis
    from tpmsd.offline.report.diagnosis_summary import diagnosis_summary
    from tpmsd.offline.report.page import Origin

    files = (("--model-out", args.model_out), ("--html", args.html), ("--plot", args.plot))
    outputs = Outputs(*files, ("--json", args.json))
    _check_options(args)
    names = unique_names(args.drives)
    recordings, simulation = _recordings(args, names)
    given, known_file = known_effects(args)
    with contextlib.ExitStack() as stack:
        gc.freeze()  # modules and drives stay: the collector need not look through them again and again
        stack.callback(gc.unfreeze)
        replays = stack.enter_context(AlarmReplays(args.drives, args.config)) if args.alarms else None
        propose = args.propose is not None
        with Progress(1.0, "diagnose", rate=False) as progress:
            if simulation is None:
                certify = Certification(_max_replicates(args.certify), np.random.default_rng(CERTIFY_SEED))
                diagnosis = diagnose(recordings, progress.update, certify, propose, given)
            else:
                diagnosis = diagnose_against(recordings[0], simulation, progress.update, propose)
        # The summary has them, unless standard output is the document's.
        for note in diagnosis.notes if outputs.fill_stdout else ():
            print(f"tpmsd: {note}", file=sys.stderr)
        alarms = []
        if replays is not None and diagnosis.verdict != INSUFFICIENT:
            alarms = replays.compared(diagnosis)
    known = diagnosis.verdict != INSUFFICIENT
    model_file = str(args.model_out) if known and args.model_out is not None else None
    read = [*_folders_read(args), *([] if known_file is None else [known_file])]
    origin = cache(lambda: provenance(SCHEMA, read, args.config or args.drives[0]))
    reason = None if known else diagnosis.reason
    code = say_verdict(reason, lambda: diagnosis_summary(diagnosis, model_file, alarms), outputs)
    comment = f"written by tpmsd diagnose from {', '.join(drive.resolve().name for drive in args.drives)}"
    outputs.write(
        {
            "--model-out": lambda: format_model(diagnosis.model, comment) if known else None,
            "--plot": lambda: plot_diagnosis(diagnosis, names, args.plot.suffix),
            "--html": lambda: diagnosis_page(diagnosis, names, Origin.now(origin()), alarms),
            "--json": lambda: json_text(
                {
                    **origin(),
                    **diagnosis_document(diagnosis, model_file, alarms),
                }
            ),
        }
    )
    if args.propose is not None and diagnosis.proposals:
        _write_proposal(args.propose, diagnosis.proposals[0], ", ".join(names))
    return code


def _recordings(args: argparse.Namespace, names: Sequence[str]) -> tuple[list[Recording], Recording | None]:
    """Return the drives, and the user's own simulation where there is one."""
    drives = [
        read_recording(drive, args.config, name) for drive, name in zip(args.drives, names, strict=True)
    ]
    return drives, None if args.simulation is None else read_recording(
        args.simulation, name="your simulation"
    )


def _check_options(args: argparse.Namespace) -> None:
    """Raise ConfigError on options that do not go together, before anything is read."""
    from tpmsd.offline.report.diagnosis_plot import check_plot_target
    from tpmsd.offline.report.page import check_report_packages

    if args.plot is not None:
        check_plot_target(args.plot)
    if args.html is not None:
        check_report_packages()
    if args.propose is not None and args.propose.is_file():
        raise ConfigError(f"--propose: {args.propose} is a file")
    if args.simulation is not None and args.model is not None:
        raise ConfigError("--model: the baseline is the simulation, not the rolling model with known effects")
    if args.simulation is not None and len(args.drives) > 1:
        raise ConfigError("--simulation is compared with one DRIVE, that of which it is a simulation")


def _write_proposal(folder: Path, proposal: Proposal, source: str) -> None:
    """Write the file of a proposed effect; TpmsdError if it cannot be written."""
    from tpmsd.offline.diagnosis.proposal.effect_file import effect_file

    name, text = effect_file(proposal, source)
    path = folder / f"{name}.py"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise TpmsdError(f"{path}: cannot be written: {error.strerror}") from None
    print(f"tpmsd: proposed {path}: review it, then name its folder with --effects-path", file=sys.stderr)


def known_effects(args: argparse.Namespace) -> tuple[ExtendedModel | None, Path | None]:
    """Return the effects of the baseline and their file: those of --model, else of the configuration.

    None with --simulation or where no model is named. ConfigError where the
    configurations of several drives name different models.
    """
    from tpmsd.car.config.load import load_config
    from tpmsd.car.physics.model_file import load_model

    if args.simulation is not None:
        return None, None
    file = args.model
    if file is None:
        configs = [args.config] if args.config is not None else args.drives
        named = {load_config(one).filter.model for one in configs}
        if len(named) > 1:
            raise ConfigError("the drives' configurations name different models: say which with --model")
        file = named.pop()
    return (None, None) if file is None else (load_model(file), file)


def _folders_read(args: argparse.Namespace) -> list[Path]:
    """Return the folders of the drives, and that of the simulation if there is one."""
    return [*args.drives, *([] if args.simulation is None else [args.simulation])]


def unique_names(folders: Sequence[Path]) -> list[str]:
    """Return the name of each drive in reports: its folder's name, or the path where names are not unique.

    ConfigError if a drive is given twice: it would count as independent evidence.
    """
    resolved = [folder.resolve() for folder in folders]
    for k, folder in enumerate(folders):
        if resolved[k] in resolved[:k]:
            raise ConfigError(f"{folder}: the drive is given twice")
    names = [folder.name for folder in resolved]
    return [
        name if names.count(name) == 1 else str(folder) for folder, name in zip(folders, names, strict=True)
    ]


def read_recording(folder: Path, config_file: Path | None = None, name: str = "the drive") -> Recording:
    """Return a drive folder as arrays, `name` for the reports; InputError if nothing usable is in it."""
    from tpmsd.car.config.load import load_config
    from tpmsd.interfaces.cli.drive_reading import read_ticks
    from tpmsd.offline.inference.recording import record

    if not folder.is_dir():
        raise InputError(folder, "not a folder" if folder.exists() else "no such drive folder")
    config = load_config(config_file if config_file is not None else folder)
    try:
        return record(read_ticks(folder, config), config, name)
    except TpmsdError:
        raise
    except ValueError as error:
        raise InputError(folder, str(error)) from None
