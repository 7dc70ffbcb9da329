"""Feeds the pipeline from the queue, so that a replay of the recording feeds it alike.

In: inputs in the queue, the clock's readings. Out: the pipeline's steps; what was fed goes to the
recorder.

Inputs are handed over in the order of their stamps up to `grace_s` ago, then the pipeline is informed that
time has come that far. The last is what a replay lacks: it knows stamps alone. So it must not change what
a tick holds (the pipeline sees to that), and where stamps are more than `MARK_S` apart, the recorder is
informed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from tpmsd.onboard.daemon.input_queue import Input, InputQueue, rounded_stamp_s
from tpmsd.onboard.daemon.recorder import DriveRecorder
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.events import SourceFault

MARK_S = 1.0
CLOCK_STEP_S = 0.25
"""A change of the wall clock against the monotonic one that is more than slewing."""
HOLD_S = 1.0


class Feeder:
    """Moves inputs from the queue into the pipeline."""

    def __init__(
        self,
        pipeline: Pipeline,
        queue: InputQueue,
        recorder: DriveRecorder | None,
        grace_s: float,
        buses: dict[str, int] | None = None,
    ) -> None:
        """`buses`: channel -> number of a further bus, as `CanDecoder.decode` has it."""
        self._buses = buses or {}
        self._pipeline = pipeline
        self._queue = queue
        self._recorder = recorder
        self._grace_s = grace_s
        self._offset_s = math.nan
        self._hold_until_s = -math.inf
        self._written_s = -math.inf
        """Latest time that the recording knows of."""
        self._advanced_s = -math.inf
        self.clock_steps = 0

    def feed(
        self, now_s: float, monotonic_s: float, faults: Callable[[float], list[SourceFault]]
    ) -> list[Step]:
        """Feed the pipeline with the inputs due at `now_s` (wall clock); return its steps.

        `faults`: the links' faults at a time.
        """
        until_s = rounded_stamp_s(now_s - self._grace_s)
        steps: list[Step] = []
        if self._clock_stepped(now_s, monotonic_s):
            for item in self._queue.release_at_clock_step(now_s):
                steps += self._hand_to_pipeline(item)
            # A replay will notice the step with the first stamp behind it, so that is waited for.
            self._hold_until_s = monotonic_s + HOLD_S
            self._written_s = self._advanced_s = -math.inf
        for item in self._queue.release(until_s):
            self._hold_until_s = -math.inf
            steps += self._hand_to_pipeline(item)
        if monotonic_s < self._hold_until_s:
            return steps
        self._record_passed_time(until_s)
        self._advanced_s = until_s
        steps += self._pipeline.advance(until_s)
        for fault in faults(until_s):
            steps += self._pipeline.on_event(fault)
        return steps

    def finish(self) -> list[Step]:
        """Feed the pipeline with all inputs at the end; return the last steps."""
        steps: list[Step] = []
        for item in self._queue.release(math.inf):
            steps += self._hand_to_pipeline(item)
        if self._recorder is not None and self._advanced_s > self._written_s:
            self._recorder.mark(self._advanced_s)
        return steps + self._pipeline.finish()

    def _hand_to_pipeline(self, item: Input) -> list[Step]:
        """Record an input and feed it to the pipeline; return the steps that it completes."""
        self._written_s = max(self._written_s, item.time_s)
        if isinstance(item, CanFrame):
            if self._recorder is not None:
                self._recorder.frame(item)
            time_s, channel, identifier, extended, _, _, _, data, _ = item
            if bus := self._buses.get(channel, 0):
                return self._pipeline.on_frame(time_s, identifier, extended, data, bus)
            return self._pipeline.on_frame(time_s, identifier, extended, data)
        if self._recorder is not None:
            self._recorder.sentence(item.time_s, item.line)
        return self._pipeline.on_sentence(item.time_s, item.line)

    def _record_passed_time(self, until_s: float) -> None:
        """Record that time went on to `until_s` while no input came."""
        if self._recorder is None or until_s - self._written_s < MARK_S:
            return
        if self._written_s < self._advanced_s:
            # The last time known before a pause of the daemon itself: a replay must see the same gap.
            self._recorder.mark(self._advanced_s)
        self._recorder.mark(until_s)
        self._written_s = until_s

    def _clock_stepped(self, now_s: float, monotonic_s: float) -> bool:
        """Return whether the host's clock has stepped against the monotonic one, and count it."""
        offset_s, before_s = now_s - monotonic_s, self._offset_s
        self._offset_s = offset_s
        if math.isnan(before_s) or abs(offset_s - before_s) < CLOCK_STEP_S:
            return False
        self.clock_steps += 1
        return True
