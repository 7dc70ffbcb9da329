"""Keeps what the estimator made of a leg, so that another monitor is tried in a sixth of the time.

In: an estimator, a folder and a key. Out: `RememberedEstimator`, which gives the same estimates to the last
bit. What was not asked for the last time (a case ended with its alarm) is estimated when it is asked for.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np

from bench.worlds.instruments import Drive
from bench.worlds.magic_tyre import Array
from tpmsd.car.config.model import Config
from tpmsd.onboard.estimators.base import NIGHT_S, Estimator, RadiusEstimate
from tpmsd.onboard.timeline.tick import Tick

OURS = ("tpmsd.", "bench.")
FIELDS = [name for name in RadiusEstimate._fields if name != "stated"]
"""Fields that the monitor reads; a second statement of the radii, for the status alone, is left out."""
SHAPES: dict[str, tuple[int, ...]] = {"deviation_m": (4,), "covariance_m2": (4, 4), "noise_std_m": (4,)}


class RememberedEstimator:
    """An estimator with a memory on disk, found by the state that was restored and the caller's key."""

    def __init__(self, real: Estimator, folder: Path, key: str) -> None:
        """`key`: all that makes the ticks and the estimator what they are."""
        self._real = real
        self._folder = folder
        self._key = key
        self._restored: tuple[dict[str, Any], float] | None = None
        self._kept: Array | None = None
        self._snapshots: dict[int, dict[str, Any]] = {}
        """By the number of ticks before each: the guard of the pipeline asks for one every few seconds."""
        self._ticks: list[Tick] = []
        self._rows: list[Array] = []
        self._loaded = False
        self._really = 0
        """Ticks that the real estimator has seen."""

    def restore(self, saved: dict[str, Any], since_s: float = NIGHT_S) -> None:
        """As the real one; before the first tick."""
        self._real.restore(saved, since_s)
        self._restored = saved, since_s

    def step(self, tick: Tick) -> RadiusEstimate:
        """From memory where it reaches, else by the real one."""
        if not self._loaded:
            self._load()
        number = len(self._ticks)
        self._ticks.append(tick)
        if self._kept is not None and number < len(self._kept):
            return _unpacked(self._kept[number])
        return self._catch_up()

    def snapshot(self) -> dict[str, Any]:
        """What was learned by the last tick."""
        number = len(self._ticks)
        if number not in self._snapshots:  # not asked for at this tick the last time
            if self._really < number:
                self._catch_up()
            self._snapshots[number] = self._real.snapshot()
        return self._snapshots[number]

    def _catch_up(self) -> RadiusEstimate:
        """Let the real one see the ticks that it has not seen; at least one."""
        for tick in self._ticks[self._really :]:
            estimate = self._real.step(tick)
            self._rows.append(_packed(estimate))
        self._really = len(self._ticks)
        return estimate

    def keep(self) -> None:
        """Write down what the real one was asked for."""
        if len(self._rows) <= (0 if self._kept is None else len(self._kept)):
            return  # no more than is there
        self._folder.mkdir(parents=True, exist_ok=True)
        file = self._file()
        part = file.with_suffix(".part.npz")
        self.snapshot()
        snapshots = np.array(json.dumps({str(number): one for number, one in self._snapshots.items()}))
        np.savez(part, rows=np.array(self._rows), snapshots=snapshots)
        part.replace(file)

    def _file(self) -> Path:
        stored = json.dumps([self._key, self._restored], sort_keys=True)
        return self._folder / f"{hashlib.sha256(stored.encode()).hexdigest()[:24]}.npz"

    def _load(self) -> None:
        self._loaded = True
        file = self._file()
        if file.exists():
            with np.load(file) as kept:
                self._kept = np.asarray(kept["rows"], dtype=np.float64)
                stored = json.loads(str(kept["snapshots"]))
                self._snapshots = {int(number): one for number, one in stored.items()}


def _packed(estimate: RadiusEstimate) -> Array:
    return np.concatenate([np.atleast_1d(getattr(estimate, name)).ravel() for name in FIELDS]).astype(
        np.float64
    )


def _unpacked(row: Array) -> RadiusEstimate:
    values: dict[str, Any] = {}
    at = 0
    for name in FIELDS:
        shape = SHAPES.get(name, ())
        size = int(np.prod(shape)) if shape else 1
        part = row[at : at + size]
        values[name] = part.reshape(shape).copy() if shape else float(part[0])
        at += size
    values["informative"] = bool(values["informative"])
    return RadiusEstimate(**values)


def key_of(drive: Drive, config: Config, estimator: Estimator, frames: bool) -> str:
    """Of all that makes the estimates: readings, configuration, and the code from the one to the other."""
    digest = hashlib.sha256()
    for name, value in sorted(vars(drive).items()):
        digest.update(name.encode())
        digest.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    digest.update(repr([config.vehicle, config.gnss, config.filter, frames]).encode())
    source = "tpmsd.onboard.timeline.tick_source" if frames else "bench.campaigns.onboard.alarms.ticks"
    digest.update(code_state(type(estimator).__module__, source).encode())
    return digest.hexdigest()


@functools.cache
def code_state(*roots: str) -> str:
    """Checksum of these modules and what they import."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in code_of(list(roots)))).hexdigest()


def code_of(roots: list[str]) -> list[Path]:
    """Files of these modules and all of ours that they import, in the order of their names.

    The package of the configuration is left out, for what comes of it is in the key.
    """
    seen: dict[str, Path] = {}
    todo = list(roots)
    while todo:
        name = todo.pop()
        if name in seen or not name.startswith(OURS) or name.startswith("tpmsd.car.config"):
            continue
        try:
            found = importlib.util.find_spec(name)
        except ModuleNotFoundError:  # a name within a module
            continue
        if found is None or found.origin is None:
            continue
        seen[name] = Path(found.origin)
        if seen[name].suffix != ".py":  # a compiled kernel imports nothing of ours
            continue
        for node in ast.walk(ast.parse(seen[name].read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                todo += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Import):
                todo += [alias.name for alias in node.names]
    return [seen[name] for name in sorted(seen)]
