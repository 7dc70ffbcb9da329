"""Frames that tpmsd sends on the car's buses beside its alarms: `[[can.output]]`, and requests for its speed.

In: steps, frames of the buses, monotonic time. Out: frames per bus (0: that of [can]).
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from cantools.database import Database

from tpmsd.car.config.model import Config
from tpmsd.onboard.daemon.obd_asker import ObdAsker
from tpmsd.onboard.monitor.settings import SIGNALS
from tpmsd.onboard.pipeline import Step
from tpmsd.onboard.sinks.can_frames import OutFrame
from tpmsd.onboard.sinks.can_output import CanOutputs
from tpmsd.onboard.sources.can.frame import CanFrame


class OwnFrames:
    """Frames that the daemon sends: its configured outputs, and its questions by OBD."""

    def __init__(self, config: Config, database: Database, log: logging.Logger) -> None:
        """ConfigError for an output that does not fit."""
        self._outputs = CanOutputs(config, database)
        self._asker = ObdAsker(config.obd)
        self._asked_bus = config.obd.bus_number(config.can)
        self._log = log
        if config.obd.speed:
            asked = (config.obd.request_id, config.obd.period_s)
            log.warning("[obd] the car is asked for its speed: 0x%X every %g s on its bus", *asked)

    def filters(self, bus: int) -> list[dict[str, Any]]:
        """Return the CAN filters that let answers, and other nodes' frames under the same identifiers,
        through."""
        asked = self._asker.filters() if bus == self._asked_bus else []
        return [*self._outputs.filters(bus), *asked]

    def received(self, bus: int, frames: list[CanFrame], monotonic_s: float) -> None:
        """Process frames of a bus; log if another node's frame ends an output or the requests."""
        asked = bool(self._asker) and bus == self._asked_bus
        if not (self._outputs or asked):
            return
        for frame in frames:
            note = self._outputs.received(bus, frame.arbitration_id, frame.is_extended)
            if asked and not note:
                note = self._asker.received(frame.arbitration_id, frame.is_extended, frame.data, monotonic_s)
            if note:
                self._log.warning("%s", note)

    def frames_of_step(self, step: Step) -> Mapping[int, list[OutFrame]]:
        """Return the configured outputs that a step makes due, by bus number."""
        return self._outputs.frames(step.tick.time_s, step.report)

    def speed_request(self, monotonic_s: float, last: Step | None) -> Mapping[int, list[OutFrame]]:
        """Return the request for the speed by bus number, an empty list if it is not due; `last`: the last
        step."""
        moving = last is not None and last.estimate.speed_mps > SIGNALS.moving_mps
        return {self._asked_bus: self._asker.frames(monotonic_s, moving)}

    def status(self, car_speed: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values for the status document; `car_speed`: what the monitor makes of the car's
        answers."""
        document: dict[str, Any] = {}
        if self._outputs:
            document["can_output"] = self._outputs.status()
        if self._asker:
            document["obd"] = {**self._asker.status(), **car_speed}
        return document
