"""`tpmsd effects [NAME]`: the catalogue of effects, and what a drive can identify.

In: an effect's name, a drive folder. Out: a summary, JSON, or the page of the docs.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.interfaces.cli.output import Subparsers, add_json_option, write_json
from tpmsd.interfaces.cli.terminal_lines import fitted_to

if TYPE_CHECKING:
    from tpmsd.offline.diagnosis.assessment.identifiability import EffectIdentifiability

_DESCRIPTION = """\
Lists the effects that `tpmsd diagnose` knows: formula, sign, units, usual size and source. With a drive: what
it could tell of each at the usual size, which effects it confounds, and the manoeuvre that would separate
them.
"""
_EPILOG = """\
examples:
  tpmsd effects
  tpmsd effects longitudinal_slip
  tpmsd effects aero_drag                   of vehicle dynamics: tpmsd diagnose --baseline
  tpmsd effects --drive drives/monday --json -
"""


def add_parser(subparsers: Subparsers) -> None:
    """Add `effects` to the command line."""
    parser = subparsers.add_parser(
        "effects",
        help="list the effects that are known, and what a drive tells of them",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", metavar="NAME", nargs="?", help="one effect alone")
    parser.add_argument("--drive", type=Path, metavar="DRIVE", help="drive folder")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="configuration instead of DRIVE/vehicle.toml"
    )
    parser.add_argument("--markdown", action="store_true", help="the reference page of the docs")
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd effects`; return the exit code."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from tpmsd.car.physics.catalogue import EFFECTS, parameters_of
    from tpmsd.car.physics.dynamics_catalogue import DYNAMICS_EFFECTS
    from tpmsd.offline.report.effects_reference import (
        dynamics_effect_document,
        dynamics_effect_summary,
        effects_document,
        effects_page,
        effects_summary,
    )

    if args.name in DYNAMICS_EFFECTS and args.name not in EFFECTS:
        if args.json is not None:
            write_json(dynamics_effect_document(args.name), args.json)
        if args.json != "-":
            print(fitted_to(sys.stdout, dynamics_effect_summary(args.name)))
        return 0
    if args.name is not None:
        parameters_of(args.name)  # says what is wrong with the name
    names = list(EFFECTS) if args.name is None else [args.name]
    if args.markdown:
        print(effects_page(), end="")
        return 0
    drive = ""
    identifiable: tuple[EffectIdentifiability, ...] = ()
    if args.drive is not None:
        from tpmsd.interfaces.cli.diagnose import read_recording
        from tpmsd.offline.diagnosis.diagnose import identifiability_on

        drive = args.drive.resolve().name
        identifiable = identifiability_on(read_recording(args.drive, args.config))
    if args.json is not None:
        write_json(effects_document(names, drive, identifiable), args.json)
    if args.json != "-":
        print(fitted_to(sys.stdout, effects_summary(names, drive, identifiable)))
    return 0
