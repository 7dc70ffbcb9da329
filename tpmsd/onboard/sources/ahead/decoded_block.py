"""A range of regular frames decoded at once.

In: a `CanDecoder`, a block of frames and a range of it. Out: a `DecodedBlock`: the samples that the decoder
would make of the frames one by one, each with the index of its frame; or None, where the next frames have to
go through the decoder one by one. Pure; nothing is changed before `DecodedBlock.commit`.

Irregular is whatever makes the decoder report or count something: a frame lost, late, repeated, too short, a
value that is invalid or that the wheel cannot have, a message that is silent, a wheel that stops or sets off.
All that is left then is arithmetic on arrays: bits, numbers, angles. Arrivals and senders are judged by
copies of the decoder's own objects, frame by frame, which takes little time.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.ahead.regular_readings import RegularReadings
from tpmsd.onboard.sources.can.arrival import MessageArrival, timeouts_of
from tpmsd.onboard.sources.can.block import ERROR, REMOTE, FrameBlock
from tpmsd.onboard.sources.can.decoder import CanDecoder, Group
from tpmsd.onboard.sources.can.senders import SenderWatch
from tpmsd.onboard.sources.can.signal_bits import RawArray, numbers, raw_bits
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT, BitField, ConditionPlan, MessagePlan, SignalPlan
from tpmsd.onboard.sources.settings import SETTINGS
from tpmsd.onboard.sources.wheel_counter import WheelCounter
from tpmsd.onboard.sources.wheel_speed import WheelSpeedIntegrator

MIN_FRAMES = 40
"""Fewer are decoded faster one by one."""

Indices = NDArray[np.intp]
Commit = Callable[[], None]


class Reason(StrEnum):
    """Reason for which a frame has to go through the decoder by itself."""

    NOT_STARTED = "message not yet received"
    ARRIVAL = "frame lost, late, repeated or of a second sender"
    SILENCE = "another message is overdue"
    UNUSABLE = "value short, invalid or doubted"
    READING = "wheel stops, sets off or jumps"
    FROZEN = "speeds frozen"


class _IrregularFrame(Exception):  # noqa: N818  (no error: it ends an attempt)
    """A frame has to go through the decoder by itself."""

    def __init__(self, index: int, reason: Reason) -> None:
        super().__init__(index, reason)
        self.index, self.reason = index, reason


class Frames(NamedTuple):
    """The n frames that hold one group of signals, in their order."""

    indices: Indices
    """(n,) in the block."""
    time_s: FloatArray
    """(n,)"""


class Angles(NamedTuple):
    """Angles of one wheel: as many `RotationSample`s in columns."""

    group: int
    """Index of the frames in `DecodedBlock.groups`."""
    angle_rad: FloatArray
    """(n,)"""
    wheel: int
    segment: int
    quantum_rad: float


class Values(NamedTuple):
    """Values of one other role."""

    group: int
    """Index of the frames in `DecodedBlock.groups`."""
    value: FloatArray
    """(n,) all finite."""
    role: str


@dataclass(frozen=True, slots=True)
class DecodedBlock:
    """Samples of the frames `start` to before `stop` of a block."""

    start: int
    stop: int
    groups: tuple[Frames, ...]
    """Frames of each group of signals that is decoded."""
    wheels: tuple[Angles, ...]
    readings: tuple[Values, ...]
    commit: Commit
    """Makes the decoder one that has decoded these frames."""


class _Arrived(NamedTuple):
    """Arrivals of a message's n frames, judged by copies of the decoder's own objects."""

    arrival: MessageArrival
    watch: SenderWatch
    periods_s: list[float]
    """The message's period at each frame, up to the first irregular one."""
    regular: int
    """Number of frames before the first irregular one; n if there is none."""

    @classmethod
    def judge(cls, group: Group, stamps_s: list[float], compared: list[tuple[int, list[float]]]) -> _Arrived:
        """Judge the arrival of the group's frames by copies of its watches; `compared` as of
        `SenderWatch.judge_regular`."""
        assert group.arrival is not None
        arrival, watch = group.arrival.copied(), group.watch.copied()
        periods_s = arrival.judge_regular(stamps_s)
        regular = min(len(periods_s), watch.judge_regular(stamps_s, compared))
        return cls(arrival, watch, periods_s, regular)


class BlockFrames:
    """The frames of a block by the message that they belong to."""

    def __init__(self, decoder: CanDecoder, block: FrameBlock, bus: NDArray[np.intp]) -> None:
        """`bus` (channels,): number of the bus of each channel."""
        numbers_of = bus[block.channel] if bus.any() else None
        self.block = block
        without_data = block.flags & (ERROR | REMOTE) != 0
        self._without_data: list[int] = np.flatnonzero(without_data).tolist()
        self.of: dict[int, Indices] = {}
        for key in decoder.plans:
            mine = ~without_data & (block.identifier == (key & ((1 << BUS_SHIFT) - 1)))
            if numbers_of is not None:
                mine &= numbers_of == key >> BUS_SHIFT
            elif key >> BUS_SHIFT:
                continue
            self.of[key] = np.flatnonzero(mine)
        self._relevant: list[int] = np.sort(np.concatenate([*self.of.values()])).tolist() if self.of else []

    def next_relevant(self, start: int) -> int:
        """Return the index of the first frame from `start` on that belongs to a decoded message."""
        number = bisect_left(self._relevant, start)
        return self._relevant[number] if number < len(self._relevant) else len(self.block)

    def next_without_data(self, start: int) -> int:
        """Return the index of the first frame from `start` on that has no data: a remote or an error
        frame."""
        number = bisect_left(self._without_data, start)
        return self._without_data[number] if number < len(self._without_data) else len(self.block)

    def indices_of_message(self, key: int, start: int, stop: int) -> Indices:
        """Return the indices of a message's frames from `start` to before `stop`."""
        indices = self.of.get(key, np.zeros(0, dtype=np.intp))
        first, last = np.searchsorted(indices, (start, stop))
        return indices[first:last]


def decode_block(
    decoder: CanDecoder, frames: BlockFrames, start: int, stop: int
) -> tuple[DecodedBlock | None, Reason | None]:
    """Decode the longest range of regular frames from `start` on, at most to before `stop`.

    Returns the range, or None where it would be shorter than `MIN_FRAMES`, and why it ends before `stop`, or
    None.
    """
    reason = None
    while stop - start >= MIN_FRAMES:
        attempt = _Attempt(decoder, frames, start, stop)
        try:
            return attempt.decode(), attempt.cut or reason
        except _IrregularFrame as irregular:
            stop, reason = irregular.index, irregular.reason
    return None, reason


class _Attempt:
    """Decodes a range; raises `_IrregularFrame` with the first frame that has to end it."""

    def __init__(self, decoder: CanDecoder, frames: BlockFrames, start: int, stop: int) -> None:
        self._decoder = decoder
        self._frames = frames
        self._start, self._stop = start, stop
        self._end, self._reason = stop, Reason.ARRIVAL
        """First irregular frame that was found, and why it is."""
        self.cut: Reason | None = None
        """Reason for which the range ends earlier than asked for."""
        self._arrived: dict[Group, _Arrived] = {}
        self._commit: list[Commit] = []
        self._groups: list[Frames] = []
        self._wheels: list[Angles] = []
        self._readings: list[Values] = []
        self._held: dict[int, tuple[Indices, NDArray[np.bool_]]] = {}
        """Condition -> frames that state it, and whether it held."""

    def decode(self) -> DecodedBlock:
        """Decode all groups of all messages; raise `_IrregularFrame` at the first frame that is irregular."""
        self._end_at_irregular_arrival()
        messages = [
            (plan, groups, self._frames.indices_of_message(key, self._start, self._stop))
            for key, (plan, groups) in self._decoder.plans.items()
        ]
        for plan, _, indices in messages:
            for condition in plan.conditions:
                self._evaluate_condition(condition, indices)
        relevant = 0
        for plan, groups, indices in messages:
            relevant += len(indices)
            for group in groups:
                self._decode_group(plan, group, indices)
        if self._end < self._stop:
            raise _IrregularFrame(self._end, self._reason)
        found = tuple(self._groups), tuple(self._wheels), tuple(self._readings)
        return DecodedBlock(self._start, self._stop, *found, self._make_commit(relevant))

    def _end_at_irregular_arrival(self) -> None:
        """End the range at the first irregular arrival, before anything is computed of values. Left out are
        messages whose values are compared with their arrival, or that may hold something else."""
        stop = self._stop
        for key, (_, groups) in self._decoder.plans.items():
            for group in groups:
                if group.arrival is None or group.plan.selectors or any(group.watch.compares):
                    continue
                indices = self._frames.indices_of_message(key, self._start, stop)
                arrived = _Arrived.judge(group, self._frames.block.time_s[indices].tolist(), [])
                if arrived.regular < len(indices):
                    stop = int(indices[arrived.regular])
                else:
                    self._arrived[group] = arrived
        if stop < self._stop:
            self._stop = self._end = stop
            self.cut = Reason.ARRIVAL
            if stop - self._start < MIN_FRAMES:
                raise _IrregularFrame(stop, Reason.ARRIVAL)

    def _make_commit(self, relevant: int) -> Commit:
        """Return the function that brings the decoder into its state behind the range; `relevant` frames were
        decoded."""
        decoder, steps, frames = self._decoder, self._commit, self._stop - self._start

        def commit() -> None:
            for step in steps:
                step()
            decoder.counts["frames"] += frames
            if frames > relevant:
                decoder.counts["ignored"] += frames - relevant
            decoder.recheck_timeouts()

        return commit

    def _note_irregular(self, index: int, reason: Reason) -> None:
        """Keep this frame as the irregular one, unless an earlier one was found."""
        if index < self._end:
            self._end, self._reason = index, reason

    # -- bits ------------------------------------------------------------------------------------------------

    def _frames_of_branch(
        self, selectors: tuple[tuple[BitField, frozenset[int]], ...], indices: Indices
    ) -> Indices:
        """Return those of the frames that hold a branch of the multiplexers."""
        for field, values in selectors:
            fits = self._frames.block.size[indices] >= field.min_bytes
            indices = indices[fits]
            indices = indices[np.isin(numbers(field, self._raw_bits(field, indices)), list(values))]
        return indices

    def _raw_bits(self, field: BitField, indices: Indices) -> RawArray:
        """Return the (n,) unsigned raw bits of a field; zeros where no frame of the block is long enough for
        it."""
        try:
            return raw_bits(field, self._frames.block.data[indices])
        except ValueError:  # no frame of the block is so long
            return np.zeros(len(indices), dtype=np.uint64)

    def _evaluate_condition(self, condition: ConditionPlan, indices: Indices) -> None:
        """Evaluate a comparison at each of the frames, and keep the result for `_condition_holds`."""
        indices = self._frames_of_branch(condition.selectors, indices)
        indices = indices[self._frames.block.size[indices] >= condition.field.min_bytes]
        bit_values, back = np.unique(self._raw_bits(condition.field, indices), return_inverse=True)
        holds = np.array([condition.holds(int(bits)) for bits in bit_values], dtype=bool)[back]
        self._held[condition.number] = indices, holds
        if len(indices):
            self._commit.append(lambda: self._decoder.holds.__setitem__(condition.number, bool(holds[-1])))

    def _condition_holds(self, number: int, indices: Indices) -> NDArray[np.bool_]:
        """Return (n,) flags: True where the condition's message stated last, up to that frame, that it
        holds."""
        indices_of, holds = self._held[number]
        before = self._decoder.holds.get(number, False)
        return np.append(holds, before)[np.searchsorted(indices_of, indices, side="right") - 1]

    # -- a group of signals ----------------------------------------------------------------------------------

    def _decode_group(self, plan: MessagePlan, group: Group, indices: Indices) -> None:
        """Decode a group of signals in the message's frames, and note the first irregular one."""
        block = self._frames.block
        indices = self._frames_of_branch(group.plan.selectors, indices)
        time_s = block.time_s[indices]
        raw = [self._raw_bits(signal.field, indices) for signal in group.plan.signals]
        values = [
            None if signal.modulus else self._signal_values(signal, bits, indices)
            for signal, bits in zip(group.plan.signals, raw, strict=True)
        ]
        unusable = self._unusable(group, indices, raw, values)
        if unusable.any():
            self._note_irregular(int(indices[np.argmax(unusable)]), Reason.UNUSABLE)
        frames = Frames(indices, time_s)
        period_s = self._judge_arrivals(group, frames, values)
        # Stamps behind an irregular frame need not rise, and trackers are asked about rising ones alone.
        sound = slice(int(np.searchsorted(indices, self._end)))
        indices, time_s, period_s = indices[sound], time_s[sound], period_s[sound]
        raw = [bits[sound] for bits in raw]
        values = [None if value is None else value[sound] for value in values]
        if len(indices) == 0:
            return
        frames = Frames(indices, time_s)
        self._groups.append(frames)
        wheels: list[RegularReadings] = []
        for number, signal in enumerate(group.plan.signals):
            tracker = group.fields[number][5]
            value = values[number]
            if isinstance(tracker, WheelCounter):
                counts = self._signed_counts(signal, raw[number], indices)
                readings = tracker.regular_readings(time_s, counts, period_s)
            elif isinstance(tracker, WheelSpeedIntegrator):
                assert value is not None
                readings = tracker.regular_readings(time_s, value, period_s)
            else:
                assert value is not None
                self._readings.append(Values(len(self._groups) - 1, value, signal.role))
                continue
            if readings.regular < len(indices):
                self._note_irregular(int(indices[readings.regular]), Reason.READING)
            self._add_angles(tracker, frames, readings)
            wheels.append(readings)
        if group.frozen is not None:
            self._end_at_frozen_speeds(
                group, indices, time_s, dict(zip(group.trackers, wheels, strict=True)), values
            )

    def _unusable(
        self, group: Group, indices: Indices, raw: list[RawArray], values: list[FloatArray | None]
    ) -> NDArray[np.bool_]:
        """Return (n,) flags of frames with a signal that is short, invalid, not qualified or no number."""
        if any(group.doubted) or group.watch.uneasy:
            return np.ones(len(indices), dtype=bool)
        found = np.zeros(len(indices), dtype=bool)
        for signal, bits, value in zip(group.plan.signals, raw, values, strict=True):
            found |= self._frames.block.size[indices] < signal.field.min_bytes
            if signal.invalid:
                found |= np.isin(bits, np.array(sorted(signal.invalid), dtype=np.uint64))
            if signal.modulus:
                found |= bits >= np.uint64(signal.modulus)
            if signal.valid_when is not None:
                found |= ~self._condition_holds(signal.valid_when, indices)
            if value is not None:
                found |= ~np.isfinite(value)
        return found

    def _signal_values(self, signal: SignalPlan, bits: RawArray, indices: Indices) -> FloatArray:
        """Return the (n,) SI values of a signal; a wheel's speed is negative while its direction bit says
        backward."""
        value = signal.gain * numbers(signal.field, bits) + signal.bias
        if signal.wheel is not None and signal.backward_when is not None:
            value = np.where(self._condition_holds(signal.backward_when, indices), -value, value)
        return value

    def _signed_counts(self, signal: SignalPlan, bits: RawArray, indices: Indices) -> NDArray[np.int64]:
        """Return the (n,) values of a counter, as if it counted down while turning backward."""
        raw = bits.astype(np.int64)
        if signal.backward_when is None:
            return raw
        direction, backward = self._decoder.direction, self._condition_holds(signal.backward_when, indices)
        signed = direction.signed_all(signal.role, raw, signal.modulus, backward)
        self._commit.append(lambda: direction.put(signal.role, int(raw[-1]), int(signed[-1])))
        return signed

    def _judge_arrivals(self, group: Group, frames: Frames, values: list[FloatArray | None]) -> FloatArray:
        """Return the (n,) message's period at each frame, s (0 behind an irregular one), and note the first
        irregular arrival."""
        if group.arrival is None:
            raise _IrregularFrame(self._start, Reason.NOT_STARTED)
        indices, stamps = frames.indices.tolist(), frames.time_s.tolist()
        arrived = self._arrived.get(group)
        if arrived is None or len(arrived.periods_s) != len(indices):
            compared = [
                (number, value.tolist())
                for number, value in enumerate(values)
                if value is not None and group.watch.compares[number]
            ]
            arrived = _Arrived.judge(group, stamps, compared)
        arrival, watch, periods, regular = arrived
        if regular < len(indices):
            self._note_irregular(indices[regular], Reason.ARRIVAL)
        self._end_at_silence(group.arrival, indices[:regular], stamps[:regular], periods[:regular])
        if indices:
            payload = self._frames.block.payload(indices[-1])

            def commit() -> None:
                arrival.set_last_data(payload)
                group.arrival, group.watch = arrival, watch

            self._commit.append(commit)
        return np.array(periods + [0.0] * (len(indices) - len(periods)))

    def _end_at_silence(
        self, before: MessageArrival, indices: list[int], stamps: list[float], periods: list[float]
    ) -> None:
        """End the range at the first frame, of whatever message, at whose stamp this message is overdue.

        `before`: the arrival before the range; `indices`, `stamps`, `periods`: of the message's frames in it,
        up to the first irregular one.
        """
        start, stop = self._start, self._stop
        # A frame meets what is known before it, so between two of the message's own the latest tells.
        first = [start, *(index + 1 for index in indices if index + 1 < stop)]
        last_s = np.array([before.last_s, *stamps])[: len(first)]
        timeout_s = np.append(before.timeout_s, timeouts_of(np.array(periods)))[: len(first)]
        time_s = self._frames.block.time_s[start:stop]
        overdue = np.maximum.reduceat(time_s, np.array(first) - start) - last_s > timeout_s
        if before.timed_out:
            overdue[0] = False
        if overdue.any():
            at = int(np.argmax(overdue))
            late = time_s[first[at] - start :] - last_s[at] > timeout_s[at]
            self._note_irregular(first[at] + int(np.argmax(late)), Reason.SILENCE)

    def _end_at_frozen_speeds(
        self,
        group: Group,
        indices: Indices,
        time_s: FloatArray,
        wheels: dict[WheelCounter | WheelSpeedIntegrator, RegularReadings],
        values: list[FloatArray | None],
    ) -> None:
        """End the range at the first speeds that all stay the same to the last bit."""
        assert group.frozen is not None
        frozen = group.frozen.copied()
        since = np.full(len(indices), -np.inf)
        for (_, _, _, _, _, tracker), value in zip(group.fields, values, strict=True):
            if isinstance(tracker, WheelSpeedIntegrator) and tracker in frozen.trackers:
                assert value is not None
                own = np.where(
                    np.abs(value * tracker.radius_m) > SETTINGS.frozen_mps,
                    wheels[tracker].still_since_s,
                    np.nan,
                )
                since = np.maximum(since, own)
        since = np.where(np.isnan(since), np.inf, since)
        first = next(
            value * tracker.radius_m
            for (_, _, _, _, _, tracker), value in zip(group.fields, values, strict=True)
            if tracker is frozen.trackers[0] and value is not None
        )
        rows = zip(time_s.tolist(), since.tolist(), first.tolist(), strict=True)
        for at, (stamp, still_s, speed_mps) in enumerate(rows):
            if frozen.update(stamp, still_s, speed_mps):
                self._note_irregular(int(indices[at]), Reason.FROZEN)
                return
        self._commit.append(lambda: setattr(group, "frozen", frozen))

    # -- out -------------------------------------------------------------------------------------------------

    def _add_angles(
        self, tracker: WheelCounter | WheelSpeedIntegrator, frames: Frames, readings: RegularReadings
    ) -> None:
        """Add the angles of one wheel to the block, and what its tracker has to do to the commit."""
        quantum = tracker.rad_per_bit if isinstance(tracker, WheelCounter) else 0.0
        group = len(self._groups) - 1
        self._wheels.append(Angles(group, readings.angle_rad, tracker.wheel, tracker.segment, quantum))
        received_s, last_s = self._decoder.received_s, float(frames.time_s[-1])
        self._commit.append(readings.commit)
        self._commit.append(lambda: received_s.__setitem__(tracker.wheel, last_s))
