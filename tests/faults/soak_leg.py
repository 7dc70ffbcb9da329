"""One leg of the soak's day, simulated in a process of its own, so that the daemon's memory is its own.

In: a folder, the number of the leg, how many there are, the day's seed and where the car stands; after these,
if it is another day than the first, true minus nominal radii and the day's beginning. Out, in that folder:
`frames` (time, identifier, bytes in hexadecimal) and `sentences` (time, text), one to a line, times in
seconds since the day's start; where the car stands afterwards, as JSON on standard output. The first leg also
writes the configuration.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from tests.faults.soak import OFFSET_M, PARKED_S, PUNCTURE_S, START_S, WHEELS
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.clock import Clocks
from tpmsd.offline.simulator.drive import DriveSpec, SimulatedDrive, simulate_drive
from tpmsd.offline.simulator.faults import Fault
from tpmsd.offline.simulator.receiver import ReceiverSpec

INERTIAL = 0xB4


def drive(
    leg: int,
    legs: int,
    leg_s: float,
    seed: int,
    place: tuple[float, float],
    offset_m: tuple[float, ...] = OFFSET_M,
    start_s: float = START_S,
) -> SimulatedDrive:
    """The leg; the last one of so many ends with a puncture."""
    punctured = (Fault("puncture", 2.0, "percent", "rr", leg_s - PUNCTURE_S, 15.0),)
    spec = DriveSpec(
        route=("mixed", "motorway", "rural")[leg % 3],
        duration_s=leg_s,
        seed=1000 * seed + leg,
        radius_offset_m=offset_m,
        faults=punctured if leg == legs - 1 else (),
        bus=BusSpec(lost_fraction=0.001),
        receiver=ReceiverSpec(latitude_deg=place[0], longitude_deg=place[1]),
        clocks=Clocks(start_utc_s=start_s + leg * (leg_s + PARKED_S)),
    )
    return simulate_drive(spec)


def write(folder: Path, leg: int, leg_s: float, made: SimulatedDrive) -> None:
    """What comes on the bus (a quarter of the inertial frames) and from the receiver."""
    begin_s = leg * (leg_s + PARKED_S) - float(made.truth()["start_host_s"])
    kept = (made.frames.frame_id == WHEELS) | (
        (made.frames.frame_id == INERTIAL) & (np.arange(len(made.frames)) % 4 == 0)
    )
    with (folder / "frames").open("w", encoding="ascii") as out:
        for time_s, number, row in zip(
            (made.frames.time_s[kept] + begin_s).tolist(),
            made.frames.frame_id[kept].tolist(),
            made.frames.data[kept],
            strict=True,
        ):
            out.write(f"{time_s!r} {number} {row.tobytes().hex()}\n")
    with (folder / "sentences").open("w", encoding="ascii") as out:
        out.writelines(f"{line.time_s + begin_s!r} {line.text}\n" for line in made.nmea)


def main() -> None:
    """Make the leg that the arguments name."""
    folder, leg, legs, seed = Path(sys.argv[1]), *map(int, sys.argv[2:5])
    leg_s, latitude_deg, longitude_deg, *more = map(float, sys.argv[5:])
    offset_m, start_s = (tuple(more[:4]), more[4]) if more else (OFFSET_M, START_S)
    made = drive(leg, legs, leg_s, seed, (latitude_deg, longitude_deg), offset_m, start_s)
    if leg == 0 and not (folder / "vehicle.toml").exists():
        (folder / "vehicle.toml").write_text(made.configuration("virtual", "day", "day"), encoding="utf-8")
        (folder / "bus.dbc").write_text(made.dbc, encoding="utf-8")
    write(folder, leg, leg_s, made)
    track = made.epochs.track
    print(json.dumps([float(track.latitude_deg[-1]), float(track.longitude_deg[-1])]))


if __name__ == "__main__":
    main()
