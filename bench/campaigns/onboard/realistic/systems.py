"""Systems that are measured: this program's core, or whatever listens on a CAN bus.

In: legs as they were driven. Out: when the lamp was lit. A system on a bus gets the car's frames as they came
and answers by a frame of a DBC, of which one signal is the lamp: any value but 0 is lit.
"""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import can
import cantools

from bench.campaigns.onboard.alarms.play import beginning, config_of, with_method
from bench.campaigns.onboard.alarms.ticks import ticks_of
from bench.worlds.folder import write_folder
from bench.worlds.trips import Driven
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database


@dataclass(frozen=True)
class Lit:
    """What a drive brought; seconds since its start, NaN for never."""

    alarm_s: float
    asked_s: float = math.nan
    """A question about tyres, of systems that ask."""


class System(Protocol):
    """What is measured. `begin` is a car that nobody has driven yet."""

    def begin(self) -> None:
        """Forget all."""

    def reset(self) -> None:
        """The driver says that the pressures are right."""

    def drive(self, driven: Driven) -> Lit:
        """Ignition on, the whole drive, ignition off."""


class Onboard:
    """This program's core, in this process."""

    def __init__(self, method: str | None = None) -> None:
        """`method`: an estimator instead of the default."""
        self._method = method
        self._state: dict[str, Any] = {}
        self._reset = False

    def begin(self) -> None:
        """Forget all."""
        self._state, self._reset = {}, False

    def reset(self) -> None:
        """Ask for a reset with the beginning of the next drive."""
        self._reset = True

    def drive(self, driven: Driven) -> Lit:
        """Play the drive; the state is kept."""
        with tempfile.TemporaryDirectory() as place:
            config = with_method(config_of(beginning(driven), Path(place)), self._method)
            pipeline = Pipeline(config, load_database(config.can.dbc))
        if self._state:
            pipeline.restore(json.loads(json.dumps(self._state)))
        if self._reset:
            pipeline.monitor.reset()
            self._reset = False
        alarm_s = asked_s = math.nan
        start_s = driven.leg.start_s
        for tick in ticks_of(driven.drive):
            report = pipeline.on_tick(tick).report
            lit = any(str(alarm.kind) in ("deflation", "radius_deviation") for alarm in report.active)
            if lit and math.isnan(alarm_s):
                alarm_s = report.time_s - start_s
            if report.questions and math.isnan(asked_s):
                asked_s = report.time_s - start_s
        self._state = json.loads(json.dumps(pipeline.snapshot()))
        return Lit(alarm_s, asked_s)


@dataclass
class OnBus:
    """A system on a CAN bus, in real time or faster."""

    bus: can.BusABC
    database: cantools.database.can.Database
    """Of its alarm frame."""
    lamp: tuple[str, str]
    """Message and signal."""
    pace: float = 1.0
    """Seconds of the drive in a second."""
    off_s: float = 60.0
    """Silence of the bus that is an ignition off, of the drive's seconds."""
    reset_frame: can.Message | None = None
    """That means a reset to the system; None: it has none, and cases with a reset go without."""
    sleep: Callable[[float], None] = time.sleep

    def begin(self) -> None:
        """Nothing can be forgotten by way of the bus: whoever measures starts the system again."""

    def reset(self) -> None:
        """Send the frame of a reset."""
        if self.reset_frame is not None:
            self.bus.send(self.reset_frame)

    def drive(self, driven: Driven) -> Lit:
        """Send the frames of the drive at their times, and listen for the lamp."""
        self.sleep(self.off_s / self.pace)
        with tempfile.TemporaryDirectory() as place:
            write_folder(driven.drive, Path(place))
            frames = list(can.CanutilsLogReader(Path(place) / "can.log"))
        begun, alarm_s = time.monotonic(), math.nan
        first_s = frames[0].timestamp
        for frame in frames:
            at_s = frame.timestamp - first_s
            early_s = begun + at_s / self.pace - time.monotonic()
            if early_s > 0.0:
                self.sleep(early_s)
            self.bus.send(frame)
            if self._is_lit() and math.isnan(alarm_s):
                alarm_s = at_s
        self.sleep(1.0 / self.pace)
        if self._is_lit() and math.isnan(alarm_s):
            alarm_s = frames[-1].timestamp - first_s
        return Lit(alarm_s)

    def _is_lit(self) -> bool:
        """Whether a frame that has come meanwhile has the lamp lit."""
        message, signal = self.lamp
        wanted = self.database.get_message_by_name(message)
        lit = False
        while (frame := self.bus.recv(0.0)) is not None:
            same = (frame.arbitration_id, frame.is_extended_id) == (wanted.frame_id, wanted.is_extended_frame)
            if same and not frame.is_error_frame:
                reported = wanted.decode(bytes(frame.data), decode_choices=False, allow_truncated=True)
                lit = lit or bool(isinstance(reported, dict) and reported.get(signal, 0))
        return lit
