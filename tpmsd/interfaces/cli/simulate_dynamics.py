"""`tpmsd simulate --baseline NAME --inputs DRIVE OUT`: what a baseline of vehicle dynamics predicts.

In: a drive folder with a table of signals, a model file. Out: a folder of the same kind with the predicted
outputs.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.diagnose_dynamics import model_effects, read_dynamics_drive
from tpmsd.interfaces.cli.output import json_text
from tpmsd.interfaces.cli.output_files import Outputs

SCHEMA = "tpmsd.simulation/2"


def run_inputs(args: argparse.Namespace) -> int:
    """Predict the outputs of a baseline from recorded inputs and write the folder; return the exit code."""
    from tpmsd.car.config.document import VEHICLE_FILE
    from tpmsd.foundation.provenance import provenance
    from tpmsd.offline.dynamics.simulate import simulated_outputs
    from tpmsd.offline.signals.columns import BRAKE, DRIVE, OUTPUTS, ROAD_WHEEL, STEERING_WHEEL
    from tpmsd.offline.signals.write import check_signals_folder, write_signals_folder

    if args.baseline is None or args.inputs is None:
        raise ConfigError("--baseline and --inputs go together")
    if args.out is None:
        raise ConfigError("tpmsd simulate --baseline: give a folder OUT")
    outputs = Outputs(("--json", args.json))
    check_signals_folder(args.out, args.force)
    baseline, drive = read_dynamics_drive(args.inputs, args.vehicle, args.baseline)
    effects = model_effects(args.model, drive.key)
    predicted = simulated_outputs(baseline, drive, effects)
    inputs, ratio = drive.inputs, baseline.car.steering_ratio
    columns = {"time_s": inputs.time_s + drive.start_s}
    columns[ROAD_WHEEL if ratio == 1.0 else STEERING_WHEEL] = inputs.steer_rad * ratio
    if baseline.forces:
        columns |= {DRIVE: inputs.drive_n, BRAKE: inputs.brake_n}
    else:
        columns |= {OUTPUTS["speed"]: inputs.speed_mps, OUTPUTS["accel_long"]: inputs.accel_long_mps2}
    columns |= {OUTPUTS[name]: values for name, values in predicted.items()}
    vehicle: Path = args.vehicle if args.vehicle is not None else args.inputs / VEHICLE_FILE
    write_signals_folder(args.out, columns, vehicle)
    document = {
        "folder": str(args.out),
        "baseline": args.baseline,
        "effects": [effect.name for effect in effects],
        "outputs": sorted(predicted),
        "duration_s": float(inputs.time_s[-1]),
    }
    if not outputs.fill_stdout:
        names = ", ".join(document["effects"]) or "none"
        print(f"{args.out}: {args.baseline} on the inputs of {args.inputs}; effects: {names}", flush=True)
    origin = provenance(SCHEMA, [args.inputs], args.vehicle or args.inputs)
    outputs.write({"--json": lambda: json_text({**origin, **document})})
    return 0
