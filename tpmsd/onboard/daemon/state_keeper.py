"""Saving of the learned state and its restoration at start.

In: the pipeline's snapshot, monotonic time. Out: the state file, written beside the loop; one log line for
everything that goes wrong with it. The state belongs to one car: its payload carries the fingerprint of the
vehicle and the signals.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import logging
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tpmsd.car.config.model import Config
from tpmsd.onboard.daemon.state_writer import StateWriter
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sinks.state_file import StateDamaged, StateError, encode_state, load_state

ALARM_INTERVAL_S = 5.0
"""Alarms that fluctuate are not saved more often than this: flash memory wears."""
FINISH_S = 5.0
"""Time that the end of the daemon waits for one write, s; systemd gives it 15 s for two."""
SET_ASIDE = "other"
"""Suffix of a state that is whole but of no use."""

Snapshot = dict[str, Any]


def fingerprint(config: Config) -> str:
    """Return the digest of the settings that the learned radii depend on: another vehicle or other signals is
    another car."""
    vehicle = dataclasses.asdict(config.vehicle)
    del vehicle["name"]  # the radii do not depend on it
    car: dict[str, Any] = {"vehicle": vehicle, "signals": config.can.signals}
    if vehicle["teeth_by_wheel"] is None:
        del vehicle["teeth_by_wheel"]  # states of versions that did not know the key stay valid
    if config.can.options:
        car["options"] = {role: dataclasses.asdict(option) for role, option in config.can.options.items()}
    return hashlib.sha256(json.dumps(car, sort_keys=True).encode("utf-8")).hexdigest()


class StateKeeper:
    """One state file; does nothing where the configuration has none."""

    def __init__(self, config: Config, log: logging.Logger, writer: StateWriter | None = None) -> None:
        self._file: Path | None = config.state.file
        self._interval_s = config.state.interval_s
        self._fingerprint = fingerprint(config)
        self._log = log
        self._writer = writer or StateWriter()
        self._saved: Snapshot | None = None
        self._writing: Snapshot | None = None
        """Content of the write that is under way."""
        self._tried_s = -math.inf
        self._urgent = self._was_urgent = False
        self._complained = False

    def restored(self, make: Callable[[], Pipeline]) -> Pipeline:
        """Return a pipeline restored from the state file, or a new one where there is no state that fits."""
        pipeline, snapshot = make(), self._load_snapshot()
        if snapshot is None:
            return pipeline
        try:
            pipeline.restore(snapshot)
        except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
            self._set_aside(" ".join(str(error).split()) or type(error).__name__)
            return make()  # the other one may have taken it up by half
        self._log.info("%s: taken up what was learned before", self._file)
        return pipeline

    def _load_snapshot(self) -> Snapshot | None:
        """Return the saved snapshot; None if there is none, or none of this car."""
        if self._file is None:
            return None
        try:
            payload = load_state(self._file, on_damaged=self._report_damage)
        except StateError as error:
            self._log.warning("%s; starting without it", error)
            return None
        if payload is None:
            return None
        if payload.get("fingerprint") != self._fingerprint:
            self._set_aside("it was learned with another vehicle or other signals")
            return None
        snapshot = payload.get("pipeline")
        if not isinstance(snapshot, dict):
            self._set_aside("it holds no snapshot")
            return None
        return snapshot

    def request_save(self) -> None:
        """Save soon after a change of alarms: those that stand must survive a restart."""
        self._urgent = True

    def service(self, now_s: float, snapshot: Callable[[], Snapshot]) -> None:
        """Collect the outcome of the last save, and start another if one is due."""
        if self._file is None:
            return
        self._collect_outcome()
        if self._writer.busy:
            return
        wait_s = min(ALARM_INTERVAL_S, self._interval_s) if self._urgent else self._interval_s
        if self._tried_s == -math.inf and not self._urgent:
            self._tried_s = now_s  # nothing was learned in the first moment
        elif now_s - self._tried_s >= wait_s:
            self._begin_save(now_s, snapshot())

    def save(self, now_s: float, snapshot: Snapshot, wait_s: float = FINISH_S) -> None:
        """Save now unless nothing has changed; wait up to `wait_s` for it, and for a write under way before
        it."""
        self._collect_outcome(wait_s)
        if not self._writer.busy:
            self._begin_save(now_s, snapshot)
            self._collect_outcome(wait_s)
        if self._writer.busy:
            self._log.error("%s: not saved: the disk does not answer", self._file)

    def _begin_save(self, now_s: float, snapshot: Snapshot) -> None:
        """Start to save, unless nothing has changed."""
        if self._file is None:
            return
        self._tried_s = now_s
        self._was_urgent, self._urgent = self._urgent, False
        if snapshot == self._saved:
            return
        try:
            payload = {"fingerprint": self._fingerprint, "pipeline": snapshot}
            content = encode_state(self._file, payload)
        except StateError as error:
            self._note_failure(error)
            return
        self._writing = snapshot
        self._writer.begin(self._file, content)

    def _collect_outcome(self, wait_s: float = 0.0) -> None:
        """Keep the outcome of the write under way, if it is over within `wait_s`."""
        if not self._writer.busy:
            return
        try:
            if not self._writer.finished(wait_s):
                return
        except StateError as error:
            self._note_failure(error)
            return
        if self._complained:
            self._log.info("%s: saved again", self._file)
        self._complained = False
        self._saved = self._writing

    def _note_failure(self, error: StateError) -> None:
        """Log the first failure of a series, and keep an urgent save urgent."""
        if not self._complained:
            self._log.error("%s; trying again later", error)
        self._complained = True
        self._urgent |= self._was_urgent

    def _report_damage(self, damaged: StateDamaged) -> None:
        self._log.warning("%s", damaged)

    def _set_aside(self, reason: str) -> None:
        """Rename a state file that does not fit, and log that."""
        assert self._file is not None
        target = self._file.with_name(f"{self._file.name}.{SET_ASIDE}")
        try:
            self._file.replace(target)
            moved = f"set aside as {target.name}"
        except OSError as error:
            moved = f"could not be set aside ({error.strerror or error})"
        self._log.warning("%s: does not fit: %s; %s, learning again", self._file, reason, moved)
