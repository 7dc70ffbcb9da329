"""Effects injected into real recordings: is what was put there found, beside what the car does of its own?

    python -m bench run injected ../shared/recordings/van-motorway-a [...]

In: drive folders. Out: a line per effect: what the diagnosis finds in the drive as it is, and with the effect
injected. Roads, noise and receiver are real; the effect's equation is written here, not taken from the
catalogue, and acts on the readings: a wheel whose radius is larger by d turns less by d / r, a receiver that
is late stamps its fixes later. Acceleration and yaw rate are those of the wheels, slopes those of the
receiver's heights, all smoothed over seconds. Drive force acts against inertia and slope: on a motorway the
slope has the greater part of it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from tpmsd.interfaces.cli.diagnose import read_recording
from tpmsd.offline.diagnosis.assessment.result import Finding
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.inference.recording import Recording

Array = NDArray[np.float64]
LOSS_M = -1.4e-3
"""20 % of the pressure."""
LEFT = (0, 2)
SMOOTH_S = 1.5
SLOW_MPS = 3.0
G_MPS2 = 9.81


class Injected:
    """A recording, and effects to inject into it."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.wheels = recording.wheels
        dt, radius = recording.dt_s, recording.car.radius_m
        distance = np.nan_to_num(recording.rotation_rad) * radius
        self.time_s: Array = (np.arange(len(distance)) + 0.5) * dt
        self.speed: Array = gaussian_filter1d(distance[:, self.wheels].mean(axis=1) / dt, SMOOTH_S / dt)
        self.pull: Array = np.gradient(self.speed, dt) + G_MPS2 * self._slope()
        turning = (distance[:, 3] - distance[:, 2]) / dt / recording.car.geometry.track_rear_m
        self.across: Array = self.speed * gaussian_filter1d(turning, SMOOTH_S / dt)

    def _slope(self) -> Array:
        """(n,) sine of the slope by the heights; zero at walking pace, and where none are known."""
        known = np.isfinite(self.recording.up_m)
        if not known.any():
            return np.zeros(len(self.time_s))
        height = np.interp(self.time_s, self.recording.fix_time_s[known], self.recording.up_m[known])
        rise = np.gradient(gaussian_filter1d(height, SMOOTH_S / self.recording.dt_s), self.recording.dt_s)
        return np.asarray(np.where(self.speed > SLOW_MPS, rise / np.maximum(self.speed, SLOW_MPS), 0.0))

    def radii(self, change_m: dict[int, Array]) -> Recording:
        """With other radii, by wheel."""
        rotation = self.recording.rotation_rad.copy()
        radius = self.recording.car.radius_m
        for wheel, change in change_m.items():
            rotation[:, wheel] *= radius[wheel] / (radius[wheel] + change)
        return replace(self.recording, rotation_rad=rotation)

    def late(self, by_s: float) -> Recording:
        """With fixes that come later."""
        return replace(self.recording, fix_time_s=self.recording.fix_time_s + by_s)

    def slipping(self, per_accel: float) -> Recording:
        """With driven wheels that turn faster under drive force."""
        rotation = self.recording.rotation_rad.copy()
        for wheel in self.wheels:
            if self.recording.car.driven[wheel]:
                rotation[:, wheel] *= 1.0 + per_accel * self.pull
        return replace(self.recording, rotation_rad=rotation)

    def all(self) -> Iterator[tuple[str, Recording]]:
        """Name and recording of each."""
        t, v, end = self.time_s, self.speed, float(self.time_s[-1])
        yield "as it is", self.recording
        for wheel, long_s in ((self.wheels[-2], 60.0), (self.wheels[-1], 1.0), (self.wheels[-2], 180.0)):
            ramp = np.clip((t - 0.4 * end) / long_s, 0.0, 1.0)
            name = f"radius_change {('fl', 'fr', 'rl', 'rr')[wheel]} {1e3 * LOSS_M:g} mm in {long_s:g} s"
            yield name, self.radii({wheel: LOSS_M * ramp})
        every = dict.fromkeys(self.wheels)
        yield "centrifugal_growth 1.7e-6", self.radii(dict.fromkeys(every, 1.7e-06 * v**2))
        warm = 1.4e-3 * (1.0 - np.exp(-t / 200.0))
        yield "thermal_growth 1.4 mm, 200 s", self.radii(dict.fromkeys(self.wheels, warm))
        for c in (4e-4, -4e-4):
            sides = {k: c * self.across * (1.0 if k in LEFT else -1.0) for k in every}
            yield f"load_transfer_lateral {c:g}", self.radii(sides)
        yield "longitudinal_slip 4e-3", self.slipping(4e-3)
        yield "gnss_latency +0.15 s", self.late(0.15)
        dip = LOSS_M * np.exp(-0.5 * ((v - float(np.median(v[v > 5.0]))) / 1.5) ** 2)
        yield (
            "unknown: dip over speed, " + ("fl", "fr", "rl", "rr")[self.wheels[-2]],
            self.radii({self.wheels[-2]: dip}),
        )
        span = LOSS_M * ((t > 0.3 * end) & (t < 0.45 * end))
        yield (
            "unknown: a span of time, " + ("fl", "fr", "rl", "rr")[self.wheels[-2]],
            self.radii({self.wheels[-2]: span}),
        )


def reported(finding: Finding) -> str:
    """A finding in a few words."""
    if finding.effect == "unknown":
        where = finding.where
        over = where.covariate or f"{where.time_spans[0][0]:.0f} to {where.time_spans[0][1]:.0f} s"
        return f"unknown {'/'.join(where.wheels)} over {over}"
    values = [
        f"{quantity.value:.3g}+-{quantity.std or 0.0:.1g}"
        if isinstance(quantity.value, float)
        else quantity.value
        for quantity in finding.parameters.values()
    ]
    return f"{finding.effect} {' '.join(str(value) for value in values)}".strip()


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("drives", nargs="+", type=Path, metavar="DRIVE")


def main(args: argparse.Namespace) -> int:
    """Print it."""
    for folder in args.drives:
        print(f"\n{folder.name}")
        for name, recording in Injected(read_recording(folder)).all():
            print(
                f"  {name:38} {'; '.join(map(reported, diagnose([recording]).findings)) or '-'}", flush=True
            )
    return 0
