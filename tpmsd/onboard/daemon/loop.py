"""The daemon's one event loop: file descriptors in, ticks by absolute deadlines, no threads, no locks.

In: configuration, DBC, clock, service manager, and the seams that open bus and receiver. Out: what the
sinks say.

A round of the loop waits for a descriptor or a deadline, reads what is there into the queue, and, when a
deadline has come, feeds the pipeline (`feeder`) and hands each of its steps to the sinks. The pipeline
alone decides what a tick is and what an alarm is; a replay of the recording decides the same.
"""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import math
import os
import threading
from collections.abc import Callable, Mapping
from errno import EADDRINUSE
from functools import partial
from typing import Any

from cantools.database import Database

from tpmsd.car.config.gnss_source import source_of
from tpmsd.car.config.model import BusConfig, Config
from tpmsd.foundation.provenance import provenance
from tpmsd.onboard.daemon.bus_link import BusInterface, BusLink, OpenBus, open_can, own_filters, reset_filters
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.deadlines import Deadlines, PeriodicTask
from tpmsd.onboard.daemon.descriptors import Descriptors
from tpmsd.onboard.daemon.feeder import Feeder
from tpmsd.onboard.daemon.frame_stamps import TOLERANCE_S, WINDOW_S, FrameStamps
from tpmsd.onboard.daemon.health import Health
from tpmsd.onboard.daemon.input_queue import InputQueue
from tpmsd.onboard.daemon.journal import LOGGER, log_alarm
from tpmsd.onboard.daemon.notify import Notices
from tpmsd.onboard.daemon.own_frames import OwnFrames
from tpmsd.onboard.daemon.receiver_link import (
    OpenReceiver,
    ReceiverLink,
    configured_receiver,
    configured_stream,
)
from tpmsd.onboard.daemon.recorder import DriveRecorder
from tpmsd.onboard.daemon.service_manager import ServiceManager
from tpmsd.onboard.daemon.signals import SignalPipe
from tpmsd.onboard.daemon.state_keeper import StateKeeper
from tpmsd.onboard.monitor.baseline.tyre_sets import NAME
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sinks.can_frames import CanReporter, OutFrame
from tpmsd.onboard.sinks.reset_request import PREFIX, ResetRequest, to_sentence
from tpmsd.onboard.sinks.sd_notify import Notifier
from tpmsd.onboard.sinks.status_server import StatusServer, StatusSocketError
from tpmsd.onboard.sinks.status_version import DOCUMENT_VERSION
from tpmsd.onboard.sources.can.decoder import can_filters
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.events import SourceFault

SCHEMA = "tpmsd.status/2"
GRACE_S = 0.06
"""Time that an input may take from its stamp to this process, s."""
POLL_S = 0.004
"""Period at which a bus without a descriptor is polled, s."""
SECOND_S = 1.0
VERBOSE_S = 5.0
RESET_PAUSE_S = 5.0
"""Resets over the socket are taken no more often: each is an input of the pipeline."""
LAG_S = 1.0
"""A loop that is this late says so."""
LAG_AGAIN_S = 60.0

MakePipeline = Callable[[Config, Database], Pipeline]


class Daemon:
    """One car's daemon; `run` it once."""

    def __init__(
        self,
        config: Config,
        database: Database,
        clock: Clock,
        notifier: Notifier,
        *,
        open_bus: OpenBus = open_can,
        open_receiver: OpenReceiver = configured_receiver,
        make_pipeline: MakePipeline = Pipeline,
        recorder: DriveRecorder | None = None,
        on_step: Callable[[Step], None] | None = None,
        frame_time: Callable[[float], float] | None = None,
        grace_s: float = GRACE_S,
        log: logging.Logger | None = None,
    ) -> None:
        """`frame_time`: from a frame's stamp to the clock's time (default: stamps are the host's real time).

        `grace_s`, back-off and all periods are logical seconds. ConfigError if DBC or alarms do not fit.
        """
        self._config = config
        self._clock = clock
        self._log = logging.getLogger(LOGGER) if log is None else log
        self._on_step = on_step
        self._frame_time = clock.from_host if frame_time is None else frame_time
        kernel = config.can.interface == "socketcan"
        self._stamps: list[FrameStamps] = []
        if frame_time is None and not kernel:
            self._stamps = [
                FrameStamps(clock.scale * TOLERANCE_S, clock.scale * WINDOW_S)
                for _ in range(1 + len(config.can.buses))
            ]
        self._recorder = recorder
        self._state = StateKeeper(config, self._log)
        self._pipeline = self._state.restored(lambda: make_pipeline(config, database))
        self._queue = InputQueue()
        self._own = OwnFrames(config, database, self._log)
        filters = [*can_filters(config, database), *reset_filters(config.alarms), *self._own.filters(0)]
        channel, out = config.can.channel, config.alarms.channel
        self._bus = BusLink(
            lambda: open_bus(config.can, filters, channel), f"CAN {channel}", self._log, kernel
        )
        self._others = [
            BusLink(
                partial(self._open_other, open_bus, bus, number, database), f"CAN {bus.channel}", self._log
            )
            for number, bus in enumerate(config.can.buses.values(), 1)
        ]
        self._out = self._bus
        if config.alarms.can and out is not None and out != channel:
            # Nothing is wanted from the other bus, but reading shows whether it is there.
            own = own_filters(config.alarms)
            self._out = BusLink(lambda: open_bus(config.can, own, out), f"CAN {out}", self._log, kernel)
        self._receiver: ReceiverLink | None = None
        source = source_of(config.gnss)
        self._receiver_name = "none" if source is None else source.label
        if source is not None and source.kind != "can":
            label, stream = f"receiver {source.label}", configured_stream(config.gnss)
            self._receiver = ReceiverLink(open_receiver(config.gnss), label, self._log, stream)
        self._reporter = CanReporter(config.alarms)
        self._notices = Notices(config.notify, self._log, os.environ)
        buses = {bus.channel: number for number, bus in enumerate(config.can.buses.values(), 1)}
        self._feeder = Feeder(self._pipeline, self._queue, recorder, grace_s, buses)
        start_s = clock.monotonic()
        self._deadlines = Deadlines(1.0 / config.filter.rate_hz, start_s)
        self._provenance = provenance(SCHEMA, (), config.file)
        self._health = Health(config, self._bus, self._receiver, self._queue, start_s)
        self._server: StatusServer | None = StatusServer(
            config.status.socket,
            self.document,
            mode=config.status.mode,
            reset=self.reset,
            explain=self.explain,
        )
        self._descriptors = Descriptors()
        self._stopping = ""
        self._reset_s = -math.inf
        self._second = PeriodicTask(clock.scale * SECOND_S)
        self._verbose = PeriodicTask(clock.scale * VERBOSE_S)
        self._lag = PeriodicTask(clock.scale * LAG_AGAIN_S)
        self._manager = ServiceManager(notifier, clock.scale)

    def _open_other(self, open_bus: OpenBus, bus: BusConfig, number: int, database: Database) -> BusInterface:
        """Open a further bus; `CanDown` as `open_bus`."""
        settings = dataclasses.replace(
            self._config.can, interface=bus.interface, channel=bus.channel, fd=bus.fd, bitrate=bus.bitrate
        )
        filters = [*can_filters(self._config, database, number), *self._own.filters(number)]
        return open_bus(settings, filters, bus.channel)

    @property
    def ticks(self) -> int:
        """Ticks so far."""
        return self._health.ticks

    @property
    def missed_deadlines(self) -> int:
        """Deadlines that passed while the loop was busy."""
        return self._deadlines.missed

    @property
    def stopped_by(self) -> str:
        """Reason of the stop: the name of a signal, or the argument of `stop`; empty while it runs."""
        return self._stopping

    def document(self) -> dict[str, Any]:
        """Return the status document as it is now."""
        document = self._health.document(self._pipeline, self._clock.monotonic(), self._deadlines.missed)
        own = self._own.status(self._pipeline.monitor.car_speed_agreement())
        return {**self._provenance, **document, **own}

    def explain(self) -> dict[str, Any]:
        """Return the reasons for which alarms are active, or for which none is."""
        return {"version": DOCUMENT_VERSION, **self._pipeline.explain()}

    def reset(self, tyres: str | None) -> str:
        """Let the pipeline learn the tyres again with its next inputs; return the reason if it cannot, else
        an empty text."""
        if tyres is not None and NAME.fullmatch(tyres) is None:
            return "that is no name of a set of tyres (a-z 0-9 _ -, at most 24 characters)"
        now_s = self._clock.monotonic()
        if now_s - self._reset_s < self._clock.scale * RESET_PAUSE_S:
            return "a reset was asked for a moment ago"
        self._reset_s = now_s
        # As an input among the others: so the recording holds it, and its replay does the same.
        self._queue.put_sentence(to_sentence(ResetRequest(tyres)), self._clock.now())
        self._log.info("asked to learn the tyres again%s", "" if tyres is None else f" ({tyres})")
        return ""

    def stop(self, why: str = "asked to") -> None:
        """End the loop in its next round; for hooks that run within it, and for signals."""
        self._stopping = self._stopping or why

    def run(self, duration_s: float = math.inf) -> None:
        """Run until a signal, `stop`, or for `duration_s` (logical)."""
        start_s = self._clock.monotonic()
        end_s = start_s + duration_s
        self._deadlines = Deadlines(1.0 / self._config.filter.rate_hz, start_s)
        with contextlib.ExitStack() as stack:
            stack.callback(self._close)
            self._start(stack)
            while not self._stopping:
                self._run_once(end_s)
                if self._clock.monotonic() >= end_s:
                    self.stop(f"{duration_s:g} s are over")
            self._finish()

    def _start(self, stack: contextlib.ExitStack) -> None:
        """Open the status server and watch for signals."""
        self._log.info("tpmsd watches %s, receiver %s", self._bus.label, self._receiver_name)
        self._open_server()
        if threading.current_thread() is threading.main_thread():
            signals = stack.enter_context(SignalPipe())
            self._descriptors.add(signals.fileno(), signals)
        if self._recorder is not None:
            self._log.info("recording to %s", self._recorder.folder)

    def _open_server(self) -> None:
        """Open the status server; go on without one if that fails, unless another daemon answers on its
        socket."""
        assert self._server is not None
        try:
            self._server.open()
        except StatusSocketError as error:
            if isinstance(error.__cause__, OSError) and error.__cause__.errno == EADDRINUSE:
                raise  # two daemons would both talk on the bus
            self._log.warning("%s; tpmsd status will not find this daemon", error)
            self._server.close()
            self._server = None
        else:
            self._descriptors.add(self._server.fileno(), self._server)

    def _run_once(self, end_s: float) -> None:
        """Wait for input or the next deadline, read all inputs, and tick if that is due."""
        now_s = self._clock.monotonic()
        for link in self._links():
            link.service(now_s)
            self._descriptors.follow(link)
        due_s = min(self._deadlines.next_s, end_s, *(link.next_try_s for link in self._links()))
        wait_s = self._clock.to_real(max(due_s - now_s, 0.0))
        if any(link.is_open and link.fileno() is None for link in self._links()):
            wait_s = min(wait_s, POLL_S)
        for owner in self._descriptors.wait(wait_s):
            if isinstance(owner, SignalPipe):
                for number in owner.read():
                    self.stop(number.name)
            elif isinstance(owner, StatusServer):
                owner.service(self._clock.monotonic())
        now_s, monotonic_s = self._collect()
        late_s = self._deadlines.due_lateness_s(monotonic_s)
        if late_s is not None:
            self._tick(now_s, monotonic_s)
            self._report_lag(late_s)

    def _collect(self) -> tuple[float, float]:
        """Read all inputs into the queue; return the clock's time (host, monotonic) before that.

        All that was stamped until then is in the queue now. Of later times that cannot be said: this process
        may be held up at any line, and what comes meanwhile waits to be read.
        """
        now_s, monotonic_s = self._clock.read()
        for number, bus in enumerate((self._bus, *self._others)):
            if frames := bus.read(monotonic_s):
                self._own.received(number, frames, monotonic_s)
                self._enqueue(number, frames, now_s)
                self._health.note_frames(monotonic_s)
        if self._out is not self._bus:
            self._out.read(monotonic_s)
        if self._receiver is not None:
            for stamp_s, line in self._receiver.read(monotonic_s, now_s):
                if not line.startswith(PREFIX):  # only the daemon itself makes these
                    self._queue.put_sentence(line, stamp_s)
        return now_s, monotonic_s

    def _enqueue(self, number: int, frames: list[CanFrame], now_s: float) -> None:
        """Queue the frames just read of bus `number`, stamped by the host's clock."""
        stamps_s = [self._frame_time(frame.time_s) for frame in frames]
        offset_s = self._stamps[number].offset_s(stamps_s, self._clock.now()) if self._stamps else 0.0
        for frame, stamp_s in zip(frames, stamps_s, strict=True):
            self._queue.put_frame(frame, stamp_s + offset_s, now_s)

    def _tick(self, now_s: float, monotonic_s: float) -> None:
        """Feed the pipeline with the inputs up to now, and handle its steps."""
        steps_before = self._feeder.clock_steps
        self._handle(self._feeder.feed(now_s, monotonic_s, self._inputs_down), monotonic_s)
        if self._feeder.clock_steps != steps_before:
            self._log.warning("the host's clock has stepped")
            for stamps in self._stamps:
                stamps.reset()
        self._state.service(monotonic_s, self._pipeline.snapshot)
        self._notices.service(monotonic_s / self._clock.scale)
        self._send(self._own.speed_request(monotonic_s, self._health.last), monotonic_s)
        self._report(monotonic_s)
        if self._second.due(monotonic_s):
            if self._server is not None:
                self._server.publish(monotonic_s)
            if self._recorder is not None:
                self._recorder.flush()

    def _handle(self, steps: list[Step], monotonic_s: float) -> None:
        """Send the frames of each step; log and announce its alarm events."""
        self._health.note_steps(steps, self._pipeline, monotonic_s)
        for step in steps:
            for event in step.report.events:
                log_alarm(self._log, event)
                self._notices.add(event)
                self._state.request_save()
            # The tick's own time, not the host's: it only rises.
            self._out.send(self._reporter.frames(step.tick.time_s, step.report), monotonic_s)
            self._send(self._own.frames_of_step(step), monotonic_s)
            if self._on_step is not None:
                self._on_step(step)

    def _send(self, frames: Mapping[int, list[OutFrame]], monotonic_s: float) -> None:
        """Send frames by the number of their bus."""
        for number, of_bus in frames.items():
            (self._bus, *self._others)[number].send(of_bus, monotonic_s)

    def _inputs_down(self, time_s: float) -> list[SourceFault]:
        """Return a fault for each bus or receiver that is down now."""
        faults = []
        for bus in (self._bus, *self._others):
            if bus.is_down:
                faults.append(SourceFault(time_s, "can", "down", bus.reason))
        if self._receiver is not None and self._receiver.is_down:
            faults.append(SourceFault(time_s, "gnss", "unplugged", self._receiver.reason))
        return faults

    def _report(self, monotonic_s: float) -> None:
        """Report the state to the service manager and the log."""
        was_ready = self._manager.is_ready
        self._manager.note_ticks(self._health.ticks, self._status_line, monotonic_s)
        if self._manager.is_ready and not was_ready:
            self._log.info("first tick: %s", self._status_line())
        elif self._verbose.due(monotonic_s):
            self._log.debug("%s", self._status_line())

    def _status_line(self) -> str:
        """Return tyres, speed, inputs and ticks in one line."""
        return self._health.line(self._pipeline, self._clock.monotonic(), self._deadlines.missed)

    def _report_lag(self, late_s: float) -> None:
        """Log that ticks are late, not more often than once in a while."""
        late_s = self._clock.to_real(late_s)
        if late_s > LAG_S and self._lag.due(self._clock.monotonic()):
            self._log.warning(
                "the loop was %.1f s late (%d deadlines missed so far)", late_s, self._deadlines.missed
            )

    def _finish(self) -> None:
        """Shut down in order: process what was received, save what was learned."""
        self._log.info("stopping: %s", self._stopping)
        self._manager.stopping(self._stopping)
        self._collect()
        monotonic_s = self._clock.monotonic()
        self._handle(self._feeder.finish(), monotonic_s)
        if self._health.last is not None:
            self._state.save(monotonic_s, self._pipeline.snapshot())

    def _close(self) -> None:
        """Close all links, files and sockets."""
        self._notices.close()
        for link in self._links():
            link.close()
        if self._server is not None:
            self._server.close()
        if self._recorder is not None:
            self._recorder.close()
        self._descriptors.close()
        self._manager.close()

    def _links(self) -> list[BusLink | ReceiverLink]:
        """Return all buses, and the receiver if there is one."""
        links: list[BusLink | ReceiverLink] = [self._bus, *self._others]
        if self._out is not self._bus:
            links.append(self._out)
        if self._receiver is not None:
            links.append(self._receiver)
        return links
