"""`tpmsd plan EFFECT...`: the shortest list of manoeuvres that distinguishes effects.

In: names of effects, a car. Out: manoeuvres with the gain expected of each effect, and a route that `tpmsd
simulate` drives; progress on standard error.
"""

from __future__ import annotations

import argparse
import os
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.output import Progress, Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs

if TYPE_CHECKING:
    from tpmsd.offline.planning.information import Equipment
    from tpmsd.offline.planning.search import Plan
    from tpmsd.offline.simulator.manoeuvres import Manoeuvre

SCHEMA = "tpmsd.plan/1"
_DESCRIPTION = """\
Proposes what to drive so that a diagnosis can name each of these effects: the shortest list of manoeuvres in
which every one of them, at its typical value, shows plainly beside all the others.
"""
_EPILOG = """\
examples:
  tpmsd plan lateral_slip antenna_lever_arm
  tpmsd plan lateral_slip antenna_lever_arm --drive drives/monday --write route.toml
  tpmsd simulate drives/planned --route-file route.toml --effect lateral_slip:coefficient=0.005

With --drive, car, sensors and noise are those of a recorded drive. Which effects a drive does not tell apart:
tpmsd effects --drive DRIVE.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Add `plan` to the command line."""
    parser = subparsers.add_parser(
        "plan",
        help="propose what to drive so that effects can be distinguished",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("effects", metavar="EFFECT", nargs="+", help="names of `tpmsd effects`")
    car = parser.add_mutually_exclusive_group()
    car.add_argument("--drive", type=Path, metavar="DRIVE", help="drive folder: its car, sensors and noise")
    car.add_argument("--vehicle", type=Path, metavar="FILE", help="a car's vehicle.toml")
    parser.add_argument("--receiver-hz", type=float, default=5.0, metavar="HZ", help="fixes (default: 5)")
    parser.add_argument(
        "--max-speed", type=float, default=33.0, metavar="M/S", help="of the road (default: 33)"
    )
    parser.add_argument(
        "--max-duration", type=float, default=1800.0, metavar="SECONDS", help="of the drive (default: 1800)"
    )
    parser.add_argument("--flat", action="store_true", help="there are no slopes")
    parser.add_argument("--write", type=Path, metavar="FILE", help="route for tpmsd simulate --route-file")
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd plan`; return the exit code."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from tpmsd.foundation.provenance import provenance
    from tpmsd.offline.planning.search import search_plan
    from tpmsd.offline.simulator.manoeuvres import LIBRARY, format_route

    outputs = Outputs(("--write", args.write), ("--json", args.json))
    effects = _checked_effects(args.effects)
    if not 0.1 <= args.receiver_hz <= 50.0:
        raise ConfigError(f"--receiver-hz {args.receiver_hz:g} is outside 0.1 to 50")
    library = [one for one in LIBRARY if one.fastest_mps <= args.max_speed and (one.flat or not args.flat)]
    if not library:
        raise ConfigError(f"--max-speed {args.max_speed:g}: no manoeuvre is as slow")
    equipment = _equipment_of(args)
    with Progress(1.0, "plan", rate=False) as progress:
        plan = search_plan(effects, equipment, library, args.max_duration, progress.update)
    outputs.say(summary(plan))
    read = [one for one in (args.drive, args.vehicle) if one is not None]
    outputs.write(
        {
            "--write": lambda: format_route(plan.manoeuvres) if plan.manoeuvres else None,
            "--json": lambda: json_text(
                {
                    **provenance(SCHEMA, read, read[0] if read else None),
                    **document(plan, str(args.write) if args.write is not None else None),
                }
            ),
        }
    )
    return 0


def document(plan: Plan, route_file: str | None) -> dict[str, Any]:
    """Return the plan as the document for JSON."""
    from tpmsd.offline.planning.search import TARGET

    return {
        "told": plan.identifies_all,
        "duration_s": plan.duration_s,
        "effects": {
            name: {"expected_gain_nats": gain, "told": gain >= TARGET} for name, gain in plan.gains.items()
        },
        "manoeuvres": [_manoeuvre_document(one) for one in plan.manoeuvres],
        "route_file": route_file,
    }


def _manoeuvre_document(one: Manoeuvre) -> dict[str, Any]:
    steps = [
        {
            "duration_s": step.duration_s,
            "speed_mps": step.speed_mps,
            "curvature_per_m": step.curvature_per_m,
            "slope": step.slope,
        }
        for step in one.steps
    ]
    return {"name": one.name, "duration_s": sum(step.duration_s for step in one.steps), "steps": steps}


def summary(plan: Plan) -> str:
    """Return the plan for people."""
    from tpmsd.car.physics.catalogue import EFFECTS
    from tpmsd.offline.planning.search import TARGET

    if any(gain >= TARGET for gain in plan.gains.values()):
        lines = [f"Drive {plan.duration_s / 60.0:.0f} min:"]
        groups = [(name, len(list(group))) for name, group in groupby(one.name for one in plan.manoeuvres)]
        lines += [
            f"  {number}. {name}" + (f", {times} times" if times > 1 else "")
            for number, (name, times) in enumerate(groups, 1)
        ]
    else:
        lines = ["No drive of these manoeuvres identifies it."]
    lines.append("Expected log-likelihood gain of each effect at its usual size beside the others (nats):")
    for name, gain in plan.gains.items():
        lines.append(f"  {name:28} {gain:8.1f}" + ("" if gain >= TARGET else "  not identifiable so"))
        if gain < TARGET and EFFECTS[name].wording.distinguished_by:
            lines.append(f"      what identifies it: {EFFECTS[name].wording.distinguished_by}")
    return "\n".join(lines)


def _checked_effects(names: list[str]) -> list[str]:
    """Return the names, each once; ConfigError on one that no manoeuvre identifies."""
    from tpmsd.car.physics.catalogue import EFFECTS, parameters_of, probes

    looked_for = {probe.effect for probe in probes()}
    for name in names:
        parameters_of(name)  # says what is wrong with the name
        if name not in looked_for or EFFECTS[name].identification.always_fitted:
            drive = EFFECTS[name].wording.distinguished_by or "none is needed"
            raise ConfigError(
                f"{name} is not identified by manoeuvres beside others; what identifies it: {drive}"
            )
    return list(dict.fromkeys(names))


def _equipment_of(args: argparse.Namespace) -> Equipment:
    """Return car, sensors and noise that a plan assumes: those of the drive, else those of the options."""
    import numpy as np

    from tpmsd.offline.inference.recording import car_of
    from tpmsd.offline.planning.information import Equipment

    if args.drive is not None:
        from tpmsd.interfaces.cli.diagnose import read_recording
        from tpmsd.offline.diagnosis.diagnose import noise_of

        recording = read_recording(args.drive)
        known = {name: bool(np.isfinite(values).mean() > 0.8) for name, values in recording.inertial.items()}
        span = float(np.ptp(recording.fix_time_s)) if len(recording.fix_time_s) > 1 else 0.0
        return Equipment(
            car=recording.car,
            receiver_hz=len(recording.fix_time_s) / span if span > 0.0 else args.receiver_hz,
            counts=bool((recording.quantum_rad > 0.0).any()),
            gyro=known["yaw_rate_radps"],
            accelerometer=known["accel_long_mps2"],
            noise=noise_of(recording),
        )
    if args.vehicle is not None:
        from tpmsd.car.config.load import load_config

        config = load_config(args.vehicle)
        signals = set(config.can.signals)
        return Equipment(
            car=car_of(config),
            receiver_hz=args.receiver_hz,
            counts=any(role.startswith("wheel_count") for role in signals),
            gyro="yaw_rate" in signals,
            accelerometer="accel_long" in signals,
        )
    from tpmsd.offline.simulator.drive import DEFAULT_VEHICLE, simulated_car

    return Equipment(car=simulated_car(DEFAULT_VEHICLE), receiver_hz=args.receiver_hz)
