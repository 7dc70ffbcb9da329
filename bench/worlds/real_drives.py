"""Pieces of real recordings as drives, as they are or with an effect injected into counts and sentences.

In: a recording's folder, a generator. Out: a drive folder. Nothing is decoded but the two counters of the
van's encoders, and of the sentences only the stamps are changed: all else stays as the road made it.
"""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from bench.worlds.recordings import lines_of

SHORTEST_S, LONGEST_S = 300.0, 540.0
COUNTERS = 0x120
"""Identifier of the encoders' frames: rear left and rear right, 32 bits each, little-endian."""
DEVELOPMENT = ("van-motorway-a", "van-motorway-c")
HELD_OUT = ("van-motorway-b", "van-motorway-d")
INJECTED = ("radius_change", "centrifugal_growth", "gnss_latency", "wheel_spin")
COUNTS_PER_REV, RADIUS_M = 39931.0, 0.315


def cut(source: Path, target: Path, rng: np.random.Generator) -> tuple[float, float]:
    """Copy a random piece of a recording; its beginning and end on the host's clock."""
    frames, sentences = lines_of(source), (source / "gnss.nmea").read_text(encoding="ascii").splitlines()
    first, last = _stamp(frames[0]), _stamp(frames[-1])
    long = min(float(rng.uniform(SHORTEST_S, LONGEST_S)), last - first)
    begin = first + float(rng.uniform(0.0, last - first - long))
    target.mkdir(parents=True, exist_ok=True)
    for name, lines in (("can.log", frames), ("gnss.nmea", sentences)):
        kept = [line for line in lines if begin <= _stamp(line) < begin + long]
        (target / name).write_text("\n".join(kept) + "\n", encoding="ascii")
    for name in ("vehicle.toml", "bus.dbc"):
        shutil.copyfile(source / name, target / name)
    return begin, begin + long


def _stamp(line: str) -> float:
    return float(line[1 : line.index(")")])


def inject(folder: Path, effect: str, rng: np.random.Generator) -> dict[str, Any]:
    """Add an effect to a drive of the van, in place; its parameters. ValueError for another name."""
    if effect == "gnss_latency":
        late = float(rng.uniform(0.1, 0.25))
        file = folder / "gnss.nmea"
        lines = file.read_text(encoding="ascii").splitlines()
        moved = [f"({_stamp(line) + late:.6f}{line[line.index(')') :]}" for line in lines]
        file.write_text("\n".join(moved) + "\n", encoding="ascii")
        return {"latency_s": late}
    if effect not in INJECTED:
        raise ValueError(f"{effect}: not among {', '.join(INJECTED)}")
    file = folder / "can.log"
    lines = file.read_text(encoding="ascii").splitlines()
    at = [k for k, line in enumerate(lines) if f" {COUNTERS:03X}#" in line]
    time_s = np.array([_stamp(lines[k]) for k in at])
    raw = np.array([np.frombuffer(bytes.fromhex(lines[k].split("#")[1]), "<u4") for k in at]).astype(np.int64)
    steps = (np.diff(raw, axis=0, prepend=raw[:1]) + 2**31) % 2**32 - 2**31
    more, parameters = _surplus(effect, time_s - time_s[0], steps, rng)
    counts = (raw + np.floor(np.cumsum(steps * more, axis=0)).astype(np.int64)) % 2**32
    for k, row in zip(at, counts.astype("<u4"), strict=True):
        lines[k] = f"{lines[k].split('#')[0]}#{row.tobytes().hex().upper()}"
    file.write_text("\n".join(lines) + "\n", encoding="ascii")
    return parameters


def _surplus(
    effect: str, since_s: np.ndarray[Any, Any], steps: np.ndarray[Any, Any], rng: np.random.Generator
) -> tuple[np.ndarray[Any, Any], dict[str, Any]]:
    """(n, 2) relative surplus of turning, and the parameters."""
    n, end = len(since_s), float(since_s[-1])
    if effect == "radius_change":
        wheel, long = int(rng.integers(2)), float(rng.choice([0.0, 60.0]))
        onset, less = float(rng.uniform(0.25, 0.6)) * end, -float(rng.uniform(1.0, 2.0)) * 1e-3
        ramp = np.clip((since_s - onset) / max(long, 1e-9), 0.0, 1.0)
        surplus = np.zeros((n, 2))
        surplus[:, wheel] = RADIUS_M / (RADIUS_M + less * ramp) - 1.0
        name = ("rl", "rr")[wheel]
        return surplus, {"wheel": name, "deviation_m": less, "onset_s": onset, "duration_s": long}
    if effect == "centrifugal_growth":
        k = float(rng.uniform(1.5e-6, 3e-6))
        window = 100
        total = np.cumsum(np.vstack([np.zeros((window, 2)), steps]), axis=0)
        span = np.maximum(since_s - np.concatenate([np.zeros(window), since_s])[:n], 0.2)
        speed = (total[window:] - total[:-window]) * (2 * math.pi * RADIUS_M / COUNTS_PER_REV) / span[:, None]
        return RADIUS_M / (RADIUS_M + k * np.clip(speed, 0.0, 40.0) ** 2) - 1.0, {"coefficient": k}
    slip, long = float(rng.uniform(0.005, 0.012)), float(rng.uniform(10, 40))
    onset = float(rng.uniform(0.25, 0.6)) * end
    acting = (since_s > onset) & (since_s < onset + long)
    event = {"wheels": ["rl", "rr"], "slip": slip, "onset_s": onset, "duration_s": long}
    return np.repeat(slip * acting[:, None], 2, axis=1), event
