"""The artificial pressure drop of Lundquist et al. (2013), eqs (39)-(41), injected into the real recordings.

In: drive folders (TPMSD_RECORDINGS, or ../shared/recordings beside the repository). Out: per recording
and method the RMSE of mu3 - mu4 on the drive as it is and with the drop.

The right rear wheel's rotation is multiplied by r / (r + delta). The drop is complete at the same share
of the drive as in the paper (5808 of 10,800 ticks). What the two tyres differ by themselves the paper
takes to be zero; here it is found without any filter, by least squares of the turns between chords of the
positions on the wheels' turns (`own_difference_m`), and is part of the truth.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.campaigns.onboard.estimators.methods import DEFAULT, INPUTS, POSITIONS, SAMPLED, available, build
from bench.campaigns.onboard.estimators.play import Played, difference, play
from bench.worlds.paper_drive import K2, PUNCTURE_M, RL, RR
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.interfaces.cli.drive_reading import read_ticks
from tpmsd.onboard.timeline.tick import Tick

Array = NDArray[np.float64]
RATE_HZ = 10.0
PAPER_TICKS = 10_800
USUAL = 500
WINDOW_S = 15.0
CHORD_S = 1.0
MIN_SPEED_MPS = 6.0


@dataclass(frozen=True)
class Recorded:
    """One method on one recording."""

    folder: str
    method: str
    particles: int

    @property
    def label(self) -> str:
        """For the progress line."""
        return f"{self.method}: {Path(self.folder).name}"


def plan(where: Path) -> list[Recorded]:
    """Every method on every recording; empty without recordings."""
    folders = sorted(p.parent for p in where.glob("*/vehicle.toml")) if where.is_dir() else []
    have, _ = available()
    return [Recorded(str(f), m, USUAL if m in SAMPLED else 0) for f in folders for m in have]


@lru_cache(maxsize=2)
def ticks_of(folder: str) -> tuple[Config, tuple[Tick, ...], float, float]:
    """Configuration of the rear pair, ticks, the tyres' own mu3 - mu4 and its standard error, m."""
    config = load_config(Path(folder) / "vehicle.toml")
    rear = {k: v for k, v in config.can.signals.items() if not k.endswith(("_fl", "_fr"))}
    config = replace(config, can=replace(config.can, signals=rear))
    ticks = read_ticks(Path(folder), config, RATE_HZ)
    return config, tuple(ticks), *own_difference_m(ticks, config)


def own_difference_m(ticks: list[Tick], config: Config) -> tuple[float, float]:
    """mu3 - mu4 of the rear tyres as they are, and its standard error.

    Over windows of 15 s, turn by chords = turn by wheels (1 + track error) - (mu3 - mu4) rotation /
    track; Huber weights.
    """
    track, radii = config.vehicle.track_rear_m, config.vehicle.wheel_radius_m
    fixes = [fix for tick in ticks for fix in tick.fixes]
    time = np.array([fix.time_s for fix in fixes])
    place = np.array([[fix.east_m, fix.north_m] for fix in fixes])
    ends = np.array([tick.time_s for tick in ticks])
    turned = np.array([np.nan_to_num(tick.rotation_rad[[RL, RR]]) for tick in ticks]).cumsum(axis=0)
    broken = np.array([not np.all(np.isfinite(tick.rotation_rad[[RL, RR]])) for tick in ticks]).cumsum()

    def heading(at: float) -> float:
        """Direction of the chord of a second about an instant; NaN where it tells none."""
        begin, end = at - CHORD_S / 2, at + CHORD_S / 2
        before = max(int(np.searchsorted(time, begin)) - 1, 0)
        after = min(int(np.searchsorted(time, end)), time.size - 1)
        east, north = (float(np.diff(np.interp([begin, end], time, place[:, k]))[0]) for k in range(2))
        if time[after] - time[before] > CHORD_S + 0.5 or math.hypot(east, north) < MIN_SPEED_MPS * CHORD_S:
            return math.nan
        return math.atan2(north, east)

    rows, seen = [], []
    for begin in np.arange(ends[0] + CHORD_S, ends[-1] - WINDOW_S - CHORD_S, WINDOW_S / 3):
        first, last = heading(begin), heading(begin + WINDOW_S)
        span = [begin, begin + WINDOW_S]
        roll = np.array([np.diff(np.interp(span, ends, turned[:, k]))[0] for k in range(2)])
        whole = float(np.diff(np.interp(span, ends, broken))[0]) == 0.0
        if not math.isfinite(first + last) or not whole:
            continue
        by_wheels = float(roll[1] * radii[RR] - roll[0] * radii[RL]) / track
        turn = math.remainder(last - first - by_wheels, 2 * math.pi)
        rows.append([-float(roll.mean()) / track, by_wheels])
        seen.append(turn)
    return _huber_first(np.array(rows), np.array(seen)) if len(rows) >= 6 else (math.nan, math.nan)


def _huber_first(A: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """First coefficient of a regression with Huber weights, and its standard error."""
    weights = np.ones(y.size)
    for _ in range(20):
        solved = np.linalg.lstsq(A * weights[:, None] ** 0.5, y * weights**0.5, rcond=None)[0]
        rest = y - A @ solved
        scale = 1.4826 * float(np.median(np.abs(rest))) + 1e-12
        weights = 1.0 / np.maximum(np.abs(rest) / (1.5 * scale), 1.0)
    # windows overlap threefold, which the standard error allows for
    information = (A * weights[:, None]).T @ A / (3.0 * scale**2)
    return float(solved[0]), float(np.sqrt(np.linalg.inv(information)[0, 0]))


def dropped(ticks: tuple[Tick, ...], radius_m: float) -> tuple[list[Tick], Array]:
    """Ticks with the artificial drop on the right rear wheel, and the added error delta (n,)."""
    complete = max(round(K2 * len(ticks) / PAPER_TICKS), 1)
    delta = PUNCTURE_M * np.minimum(np.arange(1, len(ticks) + 1) / complete, 1.0)
    out = []
    for tick, error in zip(ticks, delta, strict=True):
        rotation = tick.rotation_rad.copy()
        rotation[RR] *= radius_m / (radius_m + error)
        out.append(replace(tick, rotation_rad=rotation))
    return out, delta


def perform(item: Recorded) -> dict[str, Any]:
    """Play a recording twice."""
    config, ticks, own, own_std = ticks_of(item.folder)
    config = replace(
        config,
        filter=replace(
            config.filter,
            method=item.method,
            particles=item.particles or None,
            rate_hz=RATE_HZ,
            measurements=INPUTS[POSITIONS],
        ),
    )

    def run(some: list[Tick]) -> Played:
        return play(build(item.method, item.particles or None, 0, config=config), some)

    plain = run(list(ticks))
    with_drop, delta = dropped(ticks, config.vehicle.wheel_radius_m[RR])
    hurt = run(with_drop)
    settled = slice(round(min(120.0 * RATE_HZ, len(ticks) / 3)), None)
    row: dict[str, Any] = asdict(item) | {"own_mm": 1e3 * own, "own_std_mm": 1e3 * own_std}
    base = 0.0 if math.isnan(own) else own
    for name, played, truth in (("plain", plain, np.full(len(ticks), base)), ("drop", hurt, base - delta)):
        error = (difference(played.rear_m) - truth)[settled]
        row[f"rmse_{name}_mm"] = 1e3 * math.sqrt(float(np.mean(error**2)))
    last = slice(-round(min(60.0, len(ticks) / RATE_HZ / 4) * RATE_HZ), None)
    row["seen_drop_mm"] = 1e3 * float(np.mean((difference(hurt.rear_m) - difference(plain.rear_m))[last]))
    row["laid_drop_mm"] = -1e3 * float(delta[-1])
    row["lost"] = plain.lost + hurt.lost
    some = slice(None, None, 20)
    row["series"] = {
        "difference_mm": [round(1e3 * float(v), 4) for v in difference(hurt.rear_m)[some]],
        "truth_mm": [round(1e3 * float(v), 4) for v in (base - delta)[some]],
    }
    row["default"] = item.method == DEFAULT
    return row
