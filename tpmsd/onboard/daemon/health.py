"""Health of the daemon: for the status socket and for `systemctl status`.

In: loop, links, pipeline and the last step. Out: the status document, and one line of it.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from typing import Any

from tpmsd.car.config.gnss_source import source_of
from tpmsd.car.config.model import Config
from tpmsd.car.vehicle_state.record import VehicleState
from tpmsd.onboard.daemon.bus_link import BusLink
from tpmsd.onboard.daemon.input_queue import InputQueue
from tpmsd.onboard.daemon.receiver_link import ReceiverLink
from tpmsd.onboard.monitor.records import MonitorReport, WheelReport, WheelState
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sinks.status_document import LoopHealth, SourceHealth, SourceState, build_status

BUS_SILENT_S = 2.0
RECEIVER_SILENT_S = 3.0
RATE_WINDOW_S, RATE_STEP_S = 60.0, 5.0
"""Faults are counted over the last minute, to the next step."""
_COUNTS_OF_DECODING = frozenset({"frames", "ignored"})
GNSS_FAULTS = ("checksum", "garbage", "range", "no_fix", "frozen", "leap", "repeated", "week_rollover")


class RecentFaults:
    """Counts by kind over the last minute, from totals since the start."""

    def __init__(self) -> None:
        self._totals: deque[tuple[float, Counter[str]]] = deque()

    def update(self, now_s: float, totals: Counter[str]) -> dict[str, int]:
        """Update by the totals at a time; return those of each kind within `RATE_WINDOW_S`, no zeros."""
        kept = self._totals
        if not kept or now_s - kept[-1][0] >= RATE_STEP_S:
            kept.append((now_s, totals.copy()))
        while len(kept) > 1 and now_s - kept[1][0] >= RATE_WINDOW_S:
            kept.popleft()
        return dict(totals - kept[0][1])


class Health:
    """Gathers the state of loop and inputs; times are monotonic."""

    def __init__(
        self, config: Config, bus: BusLink, receiver: ReceiverLink | None, queue: InputQueue, start_s: float
    ) -> None:
        self._config = config
        self._source = source_of(config.gnss)
        self._bus = bus
        self._receiver = receiver
        self._queue = queue
        self._start_s = start_s
        self._frame_s = self._fix_s = math.nan
        self._fixes = 0
        self._can_recent, self._gnss_recent = RecentFaults(), RecentFaults()
        self._last_known: dict[str, tuple[float, WheelReport]] = {}
        self.ticks = 0
        self.last: Step | None = None

    def note_frames(self, now_s: float) -> None:
        """Note that frames were read at this time."""
        self._frame_s = now_s

    def note_steps(self, steps: list[Step], pipeline: Pipeline, now_s: float) -> None:
        """Note the steps that the pipeline has made, and the time of its last fix."""
        if steps:
            self.ticks += len(steps)
            self.last = steps[-1]
            report = self.last.report
            for wheel in report.wheels:
                if math.isfinite(wheel.change_m):
                    self._last_known[wheel.wheel] = report.time_s, wheel
        fixes = pipeline.assembler.counts["fixes"]
        if fixes != self._fixes:
            self._fixes, self._fix_s = fixes, now_s

    def document(self, pipeline: Pipeline, now_s: float, missed: int) -> dict[str, Any]:
        """Return the status document."""
        return build_status(
            None if self.last is None else self.last.report,
            loop=LoopHealth(now_s - self._start_s, self.ticks, missed),
            can=self._can_health(pipeline, now_s),
            gnss=self._gnss_health(pipeline, now_s),
            estimate=None if self.last is None else self.last.estimate,
            method=self._config.filter.method,
            resonance=None if pipeline.resonance is None else pipeline.resonance.status(),
            last_known=self._last_known,
            vehicle_state=self._vehicle_state(),
            vehicle_name=self._config.vehicle.name,
        )

    def _vehicle_state(self) -> tuple[str, VehicleState | None] | None:
        """Return method and last state of the vehicle-state estimator; None if none is configured."""
        method = self._config.vehicle_state.method
        if method is None:
            return None
        return method, None if self.last is None else self.last.vehicle_state

    def line(self, pipeline: Pipeline, now_s: float, missed: int) -> str:
        """Return tyres, speed, inputs and ticks in one line."""
        bus, gnss = self._can_health(pipeline, now_s), self._gnss_health(pipeline, now_s)
        parts = ["starting" if self.last is None else tyres_line(self.last.report)]
        if self.last is not None and math.isfinite(self.last.estimate.speed_mps):
            parts.append(f"{3.6 * self.last.estimate.speed_mps:.0f} km/h")
        parts += [f"bus {bus.state}", f"receiver {gnss.state}"]
        parts.append(f"{self.ticks} ticks, {missed} late")
        return "; ".join(parts)

    def _can_health(self, pipeline: Pipeline, now_s: float) -> SourceHealth:
        faults: Counter[str] = Counter()
        for name, count in pipeline.decoder.counts.items():
            if name not in _COUNTS_OF_DECODING and not name.startswith("decode."):
                faults[name.rpartition(".")[2]] += count
        faults -= pipeline.decoder.shared_faults  # a frame with four wheels that is lost is one
        bus = self._bus
        faults += bus.error_counts
        faults += Counter(
            down=bus.downs,
            dropped_by_kernel=bus.dropped,
            malformed=bus.malformed,
            error_frames=bus.counts["error_frames"],
            not_sent=bus.counts["tx_full"] + bus.counts["tx_down"],
            queue_overflow=self._queue.counts["overflow"],
            too_late=self._queue.counts["late"],
            bad_stamp=self._queue.counts["bad_stamp"],
            implausible=pipeline.timeline.counts["implausible"],
        )
        age_s = now_s - self._frame_s
        state = _source_state(bus.is_down, bus.counts["frames"] > 0, age_s, BUS_SILENT_S)
        detail = bus.reason or bus.hint
        return SourceHealth(
            state,
            self._config.can.channel,
            bus.counts["frames"],
            dict(faults),
            age_s,
            detail,
            self._can_recent.update(now_s, faults),
        )

    def _gnss_health(self, pipeline: Pipeline, now_s: float) -> SourceHealth:
        receiver, source = self._receiver, self._source
        if source is None:
            return SourceHealth(SourceState.OFF)
        counts = pipeline.assembler.counts
        faults = Counter({kind: counts[kind] for kind in GNSS_FAULTS})
        placed = pipeline.timeline.counts
        faults += Counter(  # leaves the zeros out
            late=placed["late_fixes"],
            early=placed["early_fixes"],
            off_utc=placed["off_utc"],
        )
        age_s = now_s - self._fix_s
        if receiver is None:  # its fixes come on the bus
            state = _source_state(self._bus.is_down, self._fixes > 0, age_s, RECEIVER_SILENT_S)
            recent = self._gnss_recent.update(now_s, faults)
            return SourceHealth(
                state, source.label, self._fixes, dict(faults), age_s, faults_last_minute=recent
            )
        faults += Counter(unplugged=receiver.downs, overlong=receiver.overlong)
        recent = self._gnss_recent.update(now_s, faults)
        state = _source_state(receiver.is_down, self._fixes > 0, age_s, RECEIVER_SILENT_S)
        detail = receiver.reason or receiver.hint
        return SourceHealth(state, source.label, self._fixes, dict(faults), age_s, detail, recent)


def tyres_line(report: MonitorReport) -> str:
    """Return the state of the tyres in a few words."""
    if report.active:
        alarms = sorted(
            {f"{alarm.kind}{f' {alarm.wheel}' if alarm.wheel else ''}" for alarm in report.active}
        )
        return f"ALARM: {', '.join(alarms)}"
    watched = [wheel for wheel in report.wheels if wheel.state is not WheelState.UNAVAILABLE]
    if not watched:
        return "no wheel to watch"
    if any(wheel.state is WheelState.LEARNING for wheel in watched):
        return f"learning {len(watched)} wheels, {100 * report.learning_fraction:.0f} %"
    return f"monitoring {len(watched)} wheels, no alarm"


def _source_state(down: bool, seen: bool, age_s: float, silent_s: float) -> SourceState:
    """Return the state of an input: down, waiting for its first data, silent for too long, or in order."""
    if down:
        return SourceState.DOWN
    if not seen:
        return SourceState.WAITING
    return SourceState.SILENT if age_s > silent_s else SourceState.OK
