"""At which sampling rates and quantisations does the torsional resonance tell a soft tyre?

Wheels with a rigid-ring tyre (`rigid_ring.py`, independent of the package) roll on roads of ISO 8608; tone
rings with uneven teeth and a control unit make speeds and counts of it. `tpmsd.onboard.resonance` learns
each wheel for five minutes and then sees ten minutes of the same tyre at the same pressure or at -20 %.
Every wheel is judged as one of four of which the other three are sound.

    make bench-resonance            # a quarter of an hour; BENCH_ARGS="--wheels 4 --road 2" for one road

Written: a table to standard output, and `resonance.json` and `resonance.png` to the folder of --out.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.worlds.rigid_ring import (
    ISO_CLASS_A,
    RATE_HZ,
    ToneRing,
    Tyre,
    ecu_speed_radps,
    roll,
    wandering_speed,
)
from tpmsd.onboard.resonance.evidence import SHIFTS, ResonanceEvidence, shift_log_likelihood
from tpmsd.onboard.resonance.peak_fit import Peak, PeakFit
from tpmsd.onboard.resonance.ring_errors import RingErrors
from tpmsd.onboard.resonance.spectrum import Spectrum, bins_hz, periodograms
from tpmsd.onboard.resonance.wheel_stream import WheelStream
from tpmsd.onboard.sources.events import RotationSample

FloatArray = NDArray[np.float64]

LEARN_S, DRIVE_S = 300.0, 600.0
CHECK_MIN = (1, 2, 4, 7, 10)
SHOWN_MIN = ("2", "4", "10")
RATES_HZ = (10.0, 20.0, 50.0, 100.0, 200.0)
TEETH = 48
FINE_COUNTS = 4096
TOLD = 3.0
"""d' at which soft and sound are told apart: halfway, one in fifteen of either is taken for the other."""


@dataclass(frozen=True)
class Road:
    """Where one drives."""

    name: str
    speed_mps: float
    density: float
    pitch_std: float = 0.002
    """Unevenness of the teeth, of their pitch."""


ROADS = (
    Road("35 km/h, class B", 9.8, 4.0 * ISO_CLASS_A),
    Road("55 km/h, class A", 15.0, ISO_CLASS_A),
    Road("55 km/h, class B", 15.0, 4.0 * ISO_CLASS_A),
    Road("55 km/h, B, bad ring", 15.0, 4.0 * ISO_CLASS_A, 0.006),
    Road("55 km/h, class C", 15.0, 16.0 * ISO_CLASS_A),
    Road("90 km/h, class B", 25.0, 4.0 * ISO_CLASS_A),
)


@dataclass(frozen=True)
class Signal:
    """What the bus carries."""

    name: str
    kmh_step: float = 0.0
    """Resolution of a speed signal; 0 for a counter."""
    counts_per_rev: int = 0


SIGNALS = (
    Signal("speed 0.01 km/h", kmh_step=0.01),
    Signal("speed 0.03125 km/h", kmh_step=0.03125),
    Signal("speed 1/16 km/h", kmh_step=0.0625),
    Signal("counter 48/rev", counts_per_rev=TEETH),
    Signal("counter 4096/rev", counts_per_rev=FINE_COUNTS),
    Signal("counter 10^6/rev", counts_per_rev=10**6),
)


@dataclass(frozen=True)
class Ride:
    """One wheel's passage: what its sensor saw."""

    edge_s: FloatArray
    angle_rad: FloatArray
    """At 200 Hz, for counters finer than the ring."""


def ride(road: Road, pressure: float, seconds: float, wheels: int, seed: tuple[int, ...]) -> list[Ride]:
    """Drive some wheels; each has the ring that its number gives, whatever it is driven for.

    All rides of the same length have the same speeds, as wheels of one car: how an estimate depends on the
    speed is common to all four, and no news of a tyre.
    """
    pace = np.random.default_rng((*seed[:2], round(seconds)))
    speed = wandering_speed(pace, seconds, road.speed_mps, 0.06 * road.speed_mps)
    rng = np.random.default_rng(seed)
    angle = roll(rng, Tyre().at_pressure(pressure), speed, road.density, wheels)
    every = int(RATE_HZ / 200.0)
    out = []
    for number in range(wheels):
        ring = ToneRing.uneven(np.random.default_rng((7, number)), TEETH, road.pitch_std)
        out.append(Ride(ring.edge_times_s(angle[number]), angle[number, ::every].copy()))
    return out


def readings(passage: Ride, signal: Signal, rate_hz: float) -> tuple[FloatArray, float]:
    """(angles of the samples, quantum), as the decoder makes them of the bus."""
    if signal.counts_per_rev:
        quantum = 2.0 * math.pi / signal.counts_per_rev
        if signal.counts_per_rev == TEETH:
            at_s = np.arange(int(passage.edge_s[-1] * rate_hz)) / rate_hz
            return np.asarray(np.searchsorted(passage.edge_s, at_s, side="right") * quantum), quantum
        every = round(200.0 / rate_hz)
        return np.asarray(np.floor(passage.angle_rad[::every] / quantum) * quantum), quantum
    cycle_s = min(0.01, 1.0 / rate_hz)
    speed = ecu_speed_radps(passage.edge_s, TEETH, rate_hz, cycle_s)
    step = signal.kmh_step / 3.6 / Tyre().radius_m
    speed = np.round(speed / step) * step
    return np.asarray(np.cumsum(0.5 * (speed[1:] + speed[:-1])) / rate_hz), 0.0


def peaks(
    passage: Ride, signal: Signal, rate_hz: float, fit: PeakFit, ring: RingErrors, stops_s: tuple[float, ...]
) -> tuple[list[Peak], bool]:
    """The resonance as it is known after each of these times, and whether rounding may hide it."""
    angles, quantum = readings(passage, signal, rate_hz)
    stream, spectrum, rounding = WheelStream(), Spectrum.empty(bins_hz(rate_hz).size), 0.0
    found: list[Peak] = []
    for number, angle in enumerate(angles.tolist()):
        time_s = number / rate_hz
        block = stream.add(RotationSample(time_s, 0, angle, quantum, 0))
        if block is not None:
            spectrum.add(periodograms(block, ring.remove(block), rate_hz))
            rounding = block.rounding_density()
        if len(found) < len(stops_s) and time_s >= stops_s[len(found)] - 2.0:
            found.append(fit.fit(spectrum))
    return found, spectrum.is_rounding_limited(rounding)


def shift_of(curve: FloatArray) -> float:
    """Mean change of ln f under a likelihood over shifts."""
    weight = np.exp(curve - curve.max())
    return float(weight @ SHIFTS / weight.sum())


def area(sound: FloatArray, soft: FloatArray) -> float:
    """Area under the ROC: the probability that a soft wheel looks softer than a sound one."""
    above = (soft[:, None] > sound[None, :]) + 0.5 * (soft[:, None] == sound[None, :])
    return float(above.mean())


def d_prime(sound: FloatArray, soft: FloatArray) -> float:
    """Distance of the means in standard deviations."""
    spread = math.sqrt(0.5 * (float(sound.var(ddof=1)) + float(soft.var(ddof=1))))
    return float(soft.mean() - sound.mean()) / spread if spread > 0.0 else 0.0


def judge(then: list[Peak], sound: list[Peak], soft: list[Peak]) -> dict[str, float]:
    """Ratios of all wheels at one checkpoint; four wheels or more."""
    likelihoods = [
        [shift_log_likelihood(a.log_likelihood, b.log_likelihood) for a, b in zip(then, now, strict=True)]
        for now in (sound, soft)
    ]
    quiet, loud = likelihoods
    ratios = []
    for curves in likelihoods:
        cars = (
            {0: curve, **{other: quiet[(number + other) % len(then)] for other in (1, 2, 3)}}
            for number, curve in enumerate(curves)
        )
        ratios.append(np.array([ResonanceEvidence.from_shifts(car).wheel_llr(0) for car in cars]))
    moved = [np.array([shift_of(curve) for curve in curves]) for curves in (quiet, loud)]
    return {
        "d_prime": d_prime(-moved[0], -moved[1]),
        "auc": area(ratios[0], ratios[1]),
        "llr_sound": float(np.median(ratios[0])),
        "llr_soft": float(np.median(ratios[1])),
        "worst_sound": float(ratios[0].max()),
        "shift_sound": float(moved[0].mean()),
        "shift_soft": float(moved[1].mean()),
    }


def cell(rides: dict[str, list[Ride]], signal: Signal, rate_hz: float) -> dict[str, Any]:
    """One signal at one rate on one road."""
    if PeakFit.max_frequency_hz(rate_hz) <= 0.0:
        return {"state": "off", "reason": f"sampled at {rate_hz:g} Hz"}
    fit, stops = PeakFit(rate_hz), tuple(60.0 * minute for minute in CHECK_MIN)
    wheels = len(rides["learn"])
    rings = [RingErrors() for _ in range(wheels)]
    learned = [peaks(rides["learn"][n], signal, rate_hz, fit, rings[n], (LEARN_S,)) for n in range(wheels)]
    if sum(hidden for _, hidden in learned) > wheels / 2:
        return {"state": "off", "reason": "the signal's resolution hides it"}
    on = [
        n
        for n in range(wheels)
        if learned[n][0][0].is_usable(fit.max_frequency_hz(rate_hz)) and not learned[n][1]
    ]
    if len(on) < max(4, wheels / 2):
        return {"state": "off", "reason": f"a resonance found on {len(on)} of {wheels} wheels only"}
    then = [learned[n][0][0] for n in on]
    sound, soft = (
        [peaks(rides[state][n], signal, rate_hz, fit, rings[n], stops)[0] for n in on]
        for state in ("sound", "soft")
    )
    means_hz, stds_hz = zip(*(peak.moments() for peak in then), strict=True)
    return {
        "state": "on",
        "wheels_on": len(on),
        "frequency_hz": float(np.mean(means_hz)),
        "std_hz": float(np.mean(stds_hz)),
        "scatter_hz": float(np.std(means_hz, ddof=1)),
        "minutes": {
            str(minute): judge(then, of_sound, of_soft)
            for minute, of_sound, of_soft in zip(
                CHECK_MIN,
                map(list, zip(*sound, strict=True)),
                map(list, zip(*soft, strict=True)),
                strict=True,
            )
        },
    }


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--wheels", type=int, default=8, help="wheels per road (default %(default)s)")
    parser.add_argument("--road", type=int, default=None, help="only this one, from 0")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("bench-out"))


def main(args: argparse.Namespace) -> int:
    """Run the benchmark."""
    begun = time.perf_counter()
    results: list[dict[str, Any]] = []
    print(
        "road                 signal             rate      wheels, f, std, scatter in Hz;"
        " d', auc, llr sound, llr soft at 2, 4, 10 min"
    )
    for index, road in enumerate(ROADS):
        if args.road not in (None, index):
            continue
        rides = {
            name: ride(road, pressure, seconds, args.wheels, (args.seed, index, number))
            for number, (name, pressure, seconds) in enumerate(
                (("learn", 1.0, LEARN_S), ("sound", 1.0, DRIVE_S), ("soft", 0.8, DRIVE_S))
            )
        }
        for signal in SIGNALS:
            for rate_hz in RATES_HZ:
                entry = cell(rides, signal, rate_hz)
                results.append({"road": road.name, "signal": signal.name, "rate_hz": rate_hz, **entry})
                print(line(results[-1]), flush=True)
        args.out.mkdir(parents=True, exist_ok=True)
        (args.out / "resonance.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    picture(results, args.out / "resonance.png")
    print(f"{time.perf_counter() - begun:.0f} s", file=sys.stderr)
    return 0


def line(entry: dict[str, Any]) -> str:
    """A row of the table."""
    head = f"{entry['road']:<20} {entry['signal']:<18} {entry['rate_hz']:>4g} Hz  "
    if entry["state"] == "off":
        return head + f"off: {entry['reason']}"
    reported = "  ".join(
        f"{entry['minutes'][m]['d_prime']:5.1f} {entry['minutes'][m]['auc']:.2f}"
        f" {entry['minutes'][m]['llr_sound']:+.1f} {entry['minutes'][m]['llr_soft']:+.1f}"
        for m in SHOWN_MIN
    )
    hz = f"{entry['frequency_hz']:5.1f} {entry['std_hz']:4.2f} {entry['scatter_hz']:4.2f}"
    return head + f"{entry['wheels_on']:>2} {hz}  {reported}"


def picture(results: list[dict[str, Any]], file: Path) -> None:
    """d' over time, one panel per road, one line per signal and rate."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    roads = list(dict.fromkeys(entry["road"] for entry in results))
    columns = min(len(roads), 3)
    rows = -(-len(roads) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(4.2 * columns, 3.4 * rows), squeeze=False, sharey=True
    )
    colours = {signal.name: f"C{number}" for number, signal in enumerate(SIGNALS)}
    for axis, road in zip(axes.flat, roads, strict=False):
        for entry in results:
            if entry["road"] != road or entry["state"] == "off":
                continue
            minutes = [int(minute) for minute in entry["minutes"]]
            values = [judged["d_prime"] for judged in entry["minutes"].values()]
            style = "-" if entry["rate_hz"] > 150.0 else "--"
            label = f"{entry['signal']}, {entry['rate_hz']:g} Hz"
            axis.plot(minutes, values, style, color=colours[entry["signal"]], marker=".", label=label)
        axis.axhline(TOLD, color="0.6", linewidth=0.8)
        axis.set_title(road, fontsize=10)
        axis.set_xlabel("minutes of driving")
        axis.grid(alpha=0.3)
        if not axis.lines[1:]:
            axis.text(0.5, 0.5, "off at every rate", transform=axis.transAxes, ha="center")
    for axis in list(axes.flat)[len(roads) :]:
        axis.set_visible(False)
    for row in axes:
        row[0].set_ylabel("d', sound to -20 %")
    drawn = {
        label: handle
        for axis in axes.flat
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure.tight_layout(rect=(0.0, 0.62 / (3.4 * rows), 1.0, 1.0))
    if drawn:
        figure.legend(
            drawn.values(),
            drawn.keys(),
            loc="lower center",
            ncols=3,
            fontsize=7,
            handlelength=3.5,
            frameon=False,
        )
    figure.savefig(file, dpi=90)
    plt.close(figure)
