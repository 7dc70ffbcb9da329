"""How soon a puncture is detected under each gate and each kind of weights, on calm and on hurried drives.

    python -m bench run puncture-delay [--json FILE] [--drives 2] [--first 11] [--minutes 8]

The cars are multi-body cars (`hard_drives`) on dry road. Halfway through a drive one tyre loses 0.46 % of its
radius (20 % of its pressure) or 2 % within half a minute: each wheel, each size, from the same state of
filter and monitor. Printed: the time from the beginning of the loss to the first alarm that names the wheel,
how many were not detected at all, and the alarms that were false: before the loss, or of another wheel.
"""

from __future__ import annotations

import argparse
import copy
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.worlds.commonroad_car import DT_S, Run
from bench.worlds.hard_drives import START_S, HardDrive, Setting, instrumented, truth
from tpmsd.car.config.model import FilterConfig, GnssConfig, MonitorConfig
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.estimators.build import build_filter
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.records import AlarmKind
from tpmsd.onboard.timeline.tick import Tick

LOSSES = {"20 % of pressure": 0.0046, "2 % of radius": 0.02}
OVER_S = 30.0
CARS = {"Escort": Setting(1, slip_stiffness=0.8), "BMW": Setting(2)}
CHOICES = {
    f"{gate}, {weights}": FilterConfig(gate=gate, fix_weights=weights)
    for gate in ("thresholds", "slip")
    for weights in ("square", "igg3")
}


def punctured(whole: Run, wheel: int, begin_s: float, share: float) -> Run:
    """The run with one tyre that loses this share of its radius: it turns the more often."""
    lost = share * np.clip((whole.time_s - begin_s) / OVER_S, 0.0, 1.0)
    angle = whole.angle_rad.copy()
    steps = np.diff(angle[:, wheel], prepend=angle[0, wheel])
    angle[:, wheel] = angle[0, wheel] + np.cumsum(steps / (1.0 - lost))
    return replace(whole, angle_rad=angle)


class Watch:
    """Filter and monitor of one car."""

    def __init__(self, drive: HardDrive, settings: FilterConfig) -> None:
        rng = np.random.default_rng(1)
        self._filter = build_filter(drive.vehicle, GnssConfig(), settings, rng, front=True)
        self._monitor = Monitor(drive.vehicle, MonitorConfig(), (0, 1, 2, 3))
        self.taught = 0

    def alarms(self, tick: Tick) -> list[str]:
        """Wheels of which this tick tells that they lose air."""
        estimate = self._filter.step(tick)
        self.taught += estimate.informative
        events = self._monitor.update(tick, estimate).events
        tyre = (AlarmKind.DEFLATION, AlarmKind.RADIUS_DEVIATION)
        return [str(e.wheel) for e in events if e.kind in tyre and e.state == "raised"]

    @property
    def learned(self) -> bool:
        """Whether the monitor compares with a baseline yet."""
        return self._monitor.baseline is not None


@dataclass
class Tally:
    """Over drives and wheels."""

    delays_s: dict[str, list[float]]
    """By loss; infinite where it was not detected."""
    early: int = 0
    """Alarms before the loss."""
    wrong: int = 0
    """Punctures with an alarm that named another wheel, whether before the right one or after."""
    share: float = 0.0


def play(whole: Run, seed: int, setting: Setting, tallies: dict[str, Tally]) -> None:
    """All punctures of one drive under all choices."""
    begin_s = float(whole.time_s[-1]) / 2
    sound = instrumented(whole, seed, setting=setting)
    split = next(k for k, tick in enumerate(sound.ticks) if tick.time_s - START_S > begin_s - 1.0)
    watches = {}
    for choice, tally in tallies.items():
        watch = watches[choice] = Watch(sound, CHOICES[choice])
        tally.early += sum(len(watch.alarms(tick)) for tick in sound.ticks[:split])
        tally.share += watch.taught / split
        if not watch.learned:
            raise SystemExit("the first half of a drive is too short to learn from; use --minutes")
    for name, share in LOSSES.items():
        for wheel, label in enumerate(WHEELS):
            ticks = instrumented(punctured(whole, wheel, begin_s, share), seed, setting=setting).ticks
            for choice, tally in tallies.items():
                here, delay_s, wrong = copy.deepcopy(watches[choice]), math.inf, False
                for tick in ticks[split:]:
                    for reported in here.alarms(tick):
                        if reported == label:
                            delay_s = min(delay_s, tick.time_s - START_S - begin_s)
                        wrong |= reported != label
                tally.delays_s[name].append(delay_s)
                tally.wrong += wrong


def regression(first: int, drives: int, minutes: float) -> list[dict[str, Any]]:
    """All choices on calm and hurried drives of both cars; prints a line each."""
    rows: list[dict[str, Any]] = []
    for driving, hard in (("calm", False), ("hurried", True)):
        runs = [
            (truth(seed, 60.0 * minutes, hard, setting), seed, setting)
            for setting in CARS.values()
            for seed in range(first, first + drives)
        ]
        across = np.concatenate([np.abs(run.accel_lat_mps2) for run, _, _ in runs])
        length = sum(len(run.time_s) for run, _, _ in runs) * DT_S / 60.0
        print(f"\n{driving}: {len(runs)} drives, {length:.0f} min, above 3 m/s2 across", end=" ")
        print(f"{np.mean(across > 3.0):.0%} of the time", flush=True)
        tallies = {choice: Tally({loss: [] for loss in LOSSES}) for choice in CHOICES}
        for run, seed, setting in runs:
            play(run, seed, setting, tallies)
        rows += [report(driving, choice, tally, len(runs)) for choice, tally in tallies.items()]
    return rows


def report(driving: str, name: str, tally: Tally, drives: int) -> dict[str, Any]:
    """Print and give one line."""
    parts = []
    for loss, delays in tally.delays_s.items():
        reported = np.array([d for d in delays if math.isfinite(d)])
        middle = (
            f"median {np.median(delays):.0f} s, latest {reported.max():.0f} s" if len(reported) else "none"
        )
        parts.append(f"{loss}: {len(reported)} of {len(delays)}, {middle}")
    print(
        f"  {name:20s} {tally.share / drives:4.0%} informative; {'; '.join(parts)}; "
        f"{tally.early} alarms before, {tally.wrong} with a wrong wheel",
        flush=True,
    )
    delays_s = {
        loss: [None if math.isinf(d) else d for d in delays] for loss, delays in tally.delays_s.items()
    }
    more = {"delays_s": delays_s, "early": tally.early, "wrong": tally.wrong, "share": tally.share / drives}
    return {"driving": driving, "choice": name, **more}


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--drives", type=int, default=2, help="of each car")
    parser.add_argument("--first", type=int, default=11, help="seed of the first drive")
    parser.add_argument("--minutes", type=float, default=8.0)


def main(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Run and print."""
    return regression(args.first, args.drives, args.minutes)
