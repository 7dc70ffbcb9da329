"""The compiled kernel of an MPF-PN tick (`kernel.c`), built by the system's compiler, for comparison only.

In: ticks. Out: posterior moments of the rear radii. The O(1) parts of a tick (which ticks are informative,
the first pose) are the program's own, in Python, as they are for the estimator it is compared with.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.campaigns.onboard.estimators.methods import TEXTBOOK, VEHICLE, config_of
from tpmsd.foundation.wheels import RL, RR
from tpmsd.onboard.estimators.gates.motion_gate import MotionGate
from tpmsd.onboard.estimators.pose_start import PoseFinder
from tpmsd.onboard.estimators.published.gnss_likelihood import position_variance
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Tick

Array = NDArray[np.float64]
SOURCE = Path(__file__).with_name("kernel.c")
COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-O2", "-shared", "-fPIC")
"""No vectorising beyond what -O2 does, no fast-math: a scalar kernel."""


def compile_kernel(compilers: Sequence[str] = COMPILERS) -> ctypes.CDLL | str:
    """The library, or a line that says why there is none."""
    compiler = next((found for name in compilers if (found := shutil.which(name))), None)
    if compiler is None:
        return f"no C compiler ({', '.join(compilers)}): the compiled kernel is left out"
    with tempfile.TemporaryDirectory(prefix="tpmsd-kernel-") as folder:
        built = Path(folder) / "kernel.so"
        done = subprocess.run(
            [compiler, *FLAGS, "-o", str(built), str(SOURCE), "-lm"],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            return f"{compiler} could not build the kernel: {done.stderr.strip().splitlines()[:1]}"
        library = ctypes.CDLL(str(built))  # stays mapped when the file is gone
    number, whole, pointer = ctypes.c_double, ctypes.c_int, ctypes.c_void_p
    out = ctypes.POINTER(number)
    library.filter_new.restype = pointer
    library.filter_new.argtypes = [whole, ctypes.c_uint64] + [number] * 6
    library.filter_free.argtypes = [pointer]
    library.filter_place.argtypes = [pointer] + [number] * 5
    library.filter_step.argtypes = [
        pointer,
        number,
        number,
        whole,
        number,
        whole,
        number,
        number,
        number,
        out,
    ]
    library.filter_draws.argtypes = [pointer, whole, number, whole, out]
    for name in ("filter_free", "filter_place", "filter_step", "filter_draws"):
        getattr(library, name).restype = None
    return library


class Kernel:
    """MPF-PN for the rear pair in C: with gates, floors and Student-t likelihood, without changes."""

    def __init__(self, library: ctypes.CDLL, count: int, seed: int) -> None:
        config = config_of(TEXTBOOK, count)
        settings = config.filter
        self._library = library
        self._forgetting = 1.0 - 1.0 / (settings.window_s * settings.rate_hz)
        self._gate = MotionGate(settings)
        self._finder = PoseFinder()
        radii = VEHICLE.wheel_radius_m
        self._filter = library.filter_new(
            count, seed, VEHICLE.track_rear_m, radii[RL], radii[RR],
            SETTINGS.radius_prior * radii[RL], SETTINGS.noise_m, SETTINGS.noise_floor_m,
        )  # fmt: skip
        if not self._filter:
            raise MemoryError("no memory for the particles")
        self._located = False
        self._out = (ctypes.c_double * 10)()

    def __del__(self) -> None:
        if getattr(self, "_filter", None):
            self._library.filter_free(self._filter)

    def step(self, tick: Tick) -> tuple[float, float, float]:
        """Posterior means of rl and rr and standard deviation of their difference, m."""
        left, right = float(tick.rotation_rad[RL]), float(tick.rotation_rad[RR])
        nominal = VEHICLE.wheel_radius_m
        distance = (left * nominal[RL] + right * nominal[RR]) / 2
        turn = (right * nominal[RR] - left * nominal[RL]) / VEHICLE.track_rear_m
        informative = self._gate.update(tick, distance / tick.dt_s, turn / tick.dt_s)
        fix = tick.fixes[-1] if tick.fixes else None
        used = fix is not None and self._located and distance / tick.dt_s > 0.5
        self._library.filter_step(
            self._filter,
            left,
            right,
            informative,
            self._forgetting,
            used,
            fix.east_m if fix else 0.0,
            fix.north_m if fix else 0.0,
            position_variance(fix) if fix else 1.0,
            self._out,
        )
        if fix is not None and not self._located:
            start = self._finder.update(fix, distance / tick.dt_s > 0.5)
            if start is not None:
                std = math.sqrt(position_variance(fix))
                self._library.filter_place(
                    self._filter, fix.east_m, fix.north_m, std, start.heading_rad, start.heading_std_rad
                )
                self._located = True
        out = self._out
        return out[0], out[1], math.sqrt(max(out[2] + out[4] - 2 * out[3], 0.0))

    def draws(self, what: int, dof: float, count: int) -> Array:
        """Random numbers as the kernel makes them: 0 normal, 1 chi-square of `dof`, 2 uniform."""
        out = (ctypes.c_double * count)()
        self._library.filter_draws(self._filter, what, dof, count, out)
        return np.array(out)
