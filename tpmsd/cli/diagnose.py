"""`tpmsd diagnose DRIVE...`: which physics a recorded drive holds that the rolling model leaves out.

In: drive folders. Out: a summary in plain sentences, JSON, a page with pictures, and the extended model;
progress on standard error.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.cli.output import Progress, Subparsers, add_json_option, write_json
from tpmsd.errors import ConfigError, InputError, TpmsdError

if TYPE_CHECKING:
    from tpmsd.diagnosis.result import Diagnosis
    from tpmsd.inference.recording import Recording
    from tpmsd.report.alarms_compared import AlarmsCompared

_DESCRIPTION = """\
Compares a recorded drive with the pure rolling model, finds where the two differ, names the physics that was
left out, fits it, and shows on held-out stretches of the drive that the fit holds.

DRIVE is a folder with vehicle.toml, bus.dbc, can.log (or .log.gz .asc .blf .trc .mf4) and gnss.nmea.
"""
_EPILOG = """\
examples:
  tpmsd diagnose drives/monday
  tpmsd diagnose drives/monday --json monday.json --html monday.html
  tpmsd diagnose drives/monday --model-out model.toml
  tpmsd diagnose drives/monday drives/tuesday           one car, fitted together
  tpmsd diagnose drives/monday --simulation sims/monday what your own simulator leaves out
  tpmsd diagnose drives/monday --alarms                 and what it means for the tyres
  tpmsd simulate drives/again --model model.toml        a drive that holds what was found

The extended model is written to --model-out; without it to model.toml beside the JSON file, or in the
present folder where there is none.
"""
_HEADER = "written by tpmsd diagnose"


def add_parser(subparsers: Subparsers) -> None:
    """Add `diagnose` to the command line."""
    parser = subparsers.add_parser(
        "diagnose",
        help="say which physics a recorded drive holds that the model lacks",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
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
        " not what the rolling model lacks",
    )
    parser.add_argument("--model-out", type=Path, metavar="FILE", help="where the extended model goes")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a page with pictures")
    parser.add_argument(
        "--alarms",
        action="store_true",
        help="also say what it means for the tyres: alarms and radii without and with the model"
        " (takes two replays of each drive)",
    )
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Diagnose."""
    # Thousands of small matrices: threads of the linear algebra only get in each other's way.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from tpmsd.cli.diagnose_alarms import AlarmReplays
    from tpmsd.diagnosis.diagnose import diagnose, diagnose_against
    from tpmsd.diagnosis.result import INSUFFICIENT
    from tpmsd.report.diagnosis_document import diagnosis_document
    from tpmsd.report.diagnosis_summary import diagnosis_summary

    if args.simulation is not None and len(args.drives) > 1:
        raise ConfigError("--simulation is compared with one DRIVE, that of which it is a simulation")
    names = names_of(args.drives)
    recordings = [
        read_recording(drive, args.config, name) for drive, name in zip(args.drives, names, strict=True)
    ]
    simulation = None if args.simulation is None else read_recording(args.simulation, name="your simulation")
    with contextlib.ExitStack() as stack:
        replays = stack.enter_context(AlarmReplays(args.drives, args.config)) if args.alarms else None
        with Progress(1.0, "diagnose") as progress:
            if simulation is None:
                diagnosis = diagnose(recordings, progress.update)
            else:
                diagnosis = diagnose_against(recordings[0], simulation, progress.update)
        for note in diagnosis.notes:
            print(f"tpmsd: {note}", file=sys.stderr)
        alarms = []
        if replays is not None and diagnosis.verdict != INSUFFICIENT:
            alarms = replays.compared(diagnosis)
    model_file = None
    if diagnosis.verdict != INSUFFICIENT:
        model_file = _write_model(diagnosis, args)
    if args.html is not None:
        _write_page(diagnosis, args.html, names, alarms)
    if args.json is not None:
        write_json(diagnosis_document(diagnosis, model_file, alarms), args.json)
    if args.json != "-":
        print(diagnosis_summary(diagnosis, model_file, alarms))
    return 0


def names_of(folders: Sequence[Path]) -> list[str]:
    """What reports call each drive: its folder's name, or the path as given where names are not unique.

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
    """A drive folder as arrays, `name` for the reports; InputError if nothing usable is in it."""
    from tpmsd.cli.drive_reading import read_ticks
    from tpmsd.config.load import load_config
    from tpmsd.inference.recording import record

    if not folder.is_dir():
        raise InputError(folder, "not a folder" if folder.exists() else "no such drive folder")
    config = load_config(config_file if config_file is not None else folder)
    try:
        return record(read_ticks(folder, config), config, name)
    except TpmsdError:
        raise
    except ValueError as error:
        raise InputError(folder, str(error)) from None


def _write_model(diagnosis: Diagnosis, args: argparse.Namespace) -> str | None:
    from tpmsd.physics.model_file import save_model

    target = args.model_out
    if target is None:
        beside = args.json is not None and args.json != "-"
        target = Path(args.json).parent / "model.toml" if beside else Path("model.toml")
        if target.exists() and _HEADER not in _head(target):
            print(
                f"tpmsd: {target} is not of tpmsd diagnose and was left as it is (use --model-out)",
                file=sys.stderr,
            )
            return None
    names = ", ".join(drive.resolve().name for drive in args.drives)
    save_model(target, diagnosis.model, f"{_HEADER} from {names}")
    return str(target)


def _head(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")[:200]
    except (OSError, UnicodeDecodeError):
        return ""


def _write_page(diagnosis: Diagnosis, target: Path, names: list[str], alarms: list[AlarmsCompared]) -> None:
    from tpmsd.report.diagnosis_html import diagnosis_page

    page: str = diagnosis_page(diagnosis, names, alarms)
    try:
        target.write_text(page, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{target}: cannot be written: {error.strerror}") from None
