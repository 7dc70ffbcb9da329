"""What slips by the tyre model would explain that the diagnosis' own terms do not.

    python benchmarks/slip_regressors.py [--seed 11] [--minutes 8]

A drive of each multi-body car on dry road, hurried and calm, is compared with the rolling model as
`tpmsd diagnose` does: same channels, same whitening, noise fitted with all its terms. Then columns are
fitted by least squares and their gains printed (log-likelihood over calibration alone, nats; nothing is held
out). Two columns are new, each with one free scale: the longitudinal slips of all four wheels and the side
slip of the rear axle, by `slip_traces` for a typical car of the configured geometry and driven axle.
"""

from __future__ import annotations

import argparse
from types import SimpleNamespace
from typing import Any

import numpy as np
from hard_drives import SETTINGS, HardDrive, instrumented, truth

from tpmsd.config.model import GnssConfig
from tpmsd.diagnosis.channels import CHANNELS, COURSE, WINDOW_S, Reader
from tpmsd.diagnosis.drives import admitted
from tpmsd.diagnosis.noise_fit import Stage, fit_noise
from tpmsd.diagnosis.recording import Recording, record
from tpmsd.diagnosis.study import DriveStudy, Study
from tpmsd.vehicle_state.car import typical
from tpmsd.vehicle_state.slips import slip_traces
from tpmsd.wheels import FloatArray

CARS = ("Escort, dry", "BMW, dry", "Vanagon, dry")
WHEELS, SIDE = 0, 1


def recorded(drive: HardDrive, name: str) -> Recording:
    """The drive as the diagnosis reads it."""
    config: Any = SimpleNamespace(vehicle=drive.vehicle, gnss=GnssConfig())
    return record(drive.ticks, config, name)


def slip_columns(reader: Reader, drive: HardDrive) -> FloatArray:
    """(w, 9, 2) response to slips of the typical car: wheels turn further, the course leaves the heading."""
    motion, recording, vehicle = reader.reference.motion, reader.recording, drive.vehicle
    car = typical(vehicle.wheelbase_m, vehicle.track_front_m, vehicle.track_rear_m, vehicle.driven_axle)
    middle_s = recording.edges_s[1:] - recording.dt_s / 2
    wheel = np.interp(motion.time_s, middle_s, recording.inertial["steering_wheel_angle_rad"])
    traces = slip_traces(
        car,
        motion.specific_force_long_mps2,
        motion.accel_lat_mps2,
        np.gradient(motion.yaw_rate_radps, motion.time_s),
        wheel / (vehicle.steering_ratio or 1.0),
    )

    def window(values: FloatArray) -> FloatArray:
        per = round(WINDOW_S / recording.dt_s)
        ticks = 0.5 * (values[1:] + values[:-1])
        return np.asarray(
            ticks[: len(ticks) // per * per].reshape(-1, per).mean(axis=1)[reader.windows.index]
        )

    out = np.zeros((len(reader.windows), CHANNELS, 2))
    for k in range(4):
        out[:, k, WHEELS] = reader.rolled_m[:, k] * window(traces.wheel_slip[:, k])
    out[:, COURSE, SIDE] = window(traces.side_slip_rad)
    return np.nan_to_num(out)


def gain(data: FloatArray, columns: FloatArray) -> float:
    """Log-likelihood that columns (w, 9, k) gain on white data (w, 9)."""
    target, design = data.reshape(-1), columns.reshape(data.size, -1)
    size = np.sqrt((design**2).sum(axis=0))
    design = design[:, size > 0.0] / size[size > 0.0]
    left = target - design @ np.linalg.lstsq(design, target, rcond=1e-10)[0]
    return 0.5 * float(target @ target - left @ left)


def compared(study: DriveStudy, new: FloatArray) -> list[tuple[str, int, float]]:
    """Label, number of columns and gain of each set of columns."""
    white, names = study.white, study.names

    def where(*kinds: str) -> list[int]:
        return [k for k, name in enumerate(names) if name[0] in kinds]

    calibration = where("radius", "gyro_delay")
    catalogue = [k for k, name in enumerate(names) if name[0] not in ("data", "ramp", "smooth")]
    shapes = [
        k
        for k, name in enumerate(names)
        if name[0] == "smooth" and name[1] in ("fl", "fr", "rl", "rr") and name[2] == "accel_long"
    ]
    sets: list[tuple[str, list[int], list[int]]] = [
        ("longitudinal_slip", where("longitudinal_slip"), []),
        ("wheel slips", [], [WHEELS]),
        ("free shape per wheel over accel_long", shapes, []),
        ("the same and wheel slips", shapes, [WHEELS]),
        ("lateral_slip", where("lateral_slip"), []),
        ("side slip", [], [SIDE]),
        ("whole catalogue", catalogue, []),
        ("the same and wheel slips", catalogue, [WHEELS]),
        ("the same and side slip", catalogue, [SIDE]),
        ("the same and free shapes over accel_long", catalogue + shapes, []),
        ("all of this", catalogue + shapes, [WHEELS, SIDE]),
    ]
    start = gain(white[:, :, 0], white[:, :, calibration])
    rows = []
    for label, old, added in sets:
        used = sorted({*calibration, *old})
        columns = np.concatenate([white[:, :, used], new[:, :, added]], axis=2)
        number = len(set(old) - set(calibration)) + len(added)
        rows.append((label, number, gain(white[:, :, 0], columns) - start))
    return rows


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--minutes", type=float, default=8.0)
    args = parser.parse_args()
    for hard in (True, False):
        for name in CARS:
            setting = SETTINGS[name]
            drive = instrumented(
                truth(args.seed, 60.0 * args.minutes, hard, setting), args.seed, setting=setting
            )
            study = Study(admitted([recorded(drive, name)])[0])
            one = study.drives[0]
            windows = one.reader.windows
            one.noise = fit_noise(
                windows, one.believed(study.hypotheses.everything), one.noise, Stage.FIRST, one.inflate
            )
            one.whiten()
            print(f"\n{name}, {'hurried' if hard else 'calm'}: {len(windows)} windows")
            for label, number, gained in compared(one, one.whitened(slip_columns(one.reader, drive))):
                print(f"  {label:42s} {number:3d} columns  {gained:8.1f} nats", flush=True)


if __name__ == "__main__":
    main()
