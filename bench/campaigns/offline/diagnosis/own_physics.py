"""Prints what the multi-body cars' own tyres do in bends, from their states alone.

In: the folder of integrated drives that the benchmark keeps. Out: per drive and axle, by least squares
over all instants, how much more the left wheel turns than the right one: the share that the way of the
hubs explains (1 is a rigid car), and what goes with the lateral acceleration (s2/m). Nothing of `tpmsd` is
used.

    python -m bench.campaigns.offline.diagnosis.own_physics [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from bench.worlds.multibody import BASES, course_of, file_of, parameters, prepare

AXLES = {"front": (0, 1), "rear": (2, 3)}


def main(folder: Path) -> int:
    """Print a line per drive and axle."""
    prepare(folder, print)
    for number, (car, road) in enumerate(BASES):
        with np.load(file_of(folder, number)) as loaded:
            course = course_of(dict(loaded), parameters(car))
        assert course.hubs is not None
        assert course.spin is not None
        turning = (1.0 + course.spin) * course.hubs
        for axle, (left, right) in AXLES.items():
            distance = (course.hubs[:, left] - course.hubs[:, right]) / course.speed
            more = (turning[:, left] - turning[:, right]) / course.speed
            columns = np.stack([distance, course.a_lat], axis=1)
            (share, by_accel), *_ = np.linalg.lstsq(columns, more, rcond=None)
            print(
                f"car {car} {road:9s} {axle:5s} way {share:6.3f}  lateral acceleration {by_accel:9.2e} s2/m"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "bench-out/diagnosis/courses")))
