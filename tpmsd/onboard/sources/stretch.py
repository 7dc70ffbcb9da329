"""A stretch of frames in which nothing is odd, decoded at once.

In: a `CanDecoder`, a block of frames and a range of it. Out: a `Stretch`: the samples that the decoder would
make of the frames one by one, each with the place of its frame; or None, where the very next frames have to
go through the decoder one by one. Pure; nothing is changed before `Stretch.settle`.

Odd is whatever makes the decoder say or count something: a frame lost, late, repeated, too short, a value
that is invalid or that the wheel cannot have, a message that is silent, a wheel that stops or sets off. All
that is left then is arithmetic on arrays: bits, numbers, angles. Arrivals and senders are judged by copies of
the decoder's own objects, frame by frame, for that takes little.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.can_arrival import MessageArrival, timeout_of
from tpmsd.onboard.sources.can_block import ERROR, REMOTE, FrameBlock
from tpmsd.onboard.sources.can_decoder import CanDecoder, Group
from tpmsd.onboard.sources.even_readings import Even, even_counts, even_speeds
from tpmsd.onboard.sources.settings import SETTINGS
from tpmsd.onboard.sources.signal_bits import RawArray, numbers, raw_bits
from tpmsd.onboard.sources.signal_plan import BUS_SHIFT, BitField, ConditionPlan, MessagePlan, SignalPlan
from tpmsd.onboard.sources.wheel_counter import WheelCounter
from tpmsd.onboard.sources.wheel_speed import WheelSpeedIntegrator

MIN_FRAMES = 40
"""Fewer are decoded faster one by one."""

Places = NDArray[np.intp]
Settle = Callable[[], None]


class Odd(Exception):  # noqa: N818  (no error: it ends a try)
    """A frame has to go through the decoder."""

    def __init__(self, place: int) -> None:
        super().__init__(place)
        self.place = place


class Frames(NamedTuple):
    """Those n that hold one group of signals, in their order."""

    places: Places
    """(n,) in the block."""
    time_s: FloatArray
    """(n,)"""


class Angles(NamedTuple):
    """Of one wheel; as many `RotationSample`s in columns."""

    group: int
    """Whose frames of the stretch these are."""
    angle_rad: FloatArray
    """(n,)"""
    wheel: int
    segment: int
    quantum_rad: float


class Values(NamedTuple):
    """Of one other role."""

    group: int
    """As above."""
    value: FloatArray
    """(n,) all finite."""
    role: str


@dataclass(frozen=True, slots=True)
class Stretch:
    """The frames `start` to before `stop` of a block, decoded."""

    start: int
    stop: int
    groups: tuple[Frames, ...]
    """Of each group of signals that is decoded."""
    wheels: tuple[Angles, ...]
    readings: tuple[Values, ...]
    settle: Settle
    """Makes the decoder one that has decoded these frames."""


class BlockPlaces:
    """Which frames of a block belong to which message."""

    def __init__(self, decoder: CanDecoder, block: FrameBlock, bus: NDArray[np.intp]) -> None:
        """`bus` (channels,): number of the bus of each channel."""
        numbers_of = bus[block.channel] if bus.any() else None
        self.block = block
        untold = block.flags & (ERROR | REMOTE) != 0
        self._untold: list[int] = np.flatnonzero(untold).tolist()
        self.of: dict[int, Places] = {}
        for key in decoder.plans:
            mine = ~untold & (block.identifier == (key & ((1 << BUS_SHIFT) - 1)))
            if numbers_of is not None:
                mine &= numbers_of == key >> BUS_SHIFT
            elif key >> BUS_SHIFT:
                continue
            self.of[key] = np.flatnonzero(mine)
        self._telling: list[int] = np.sort(np.concatenate([*self.of.values()])).tolist() if self.of else []

    def telling_from(self, start: int) -> int:
        """The first frame from a place on that belongs to a message."""
        number = bisect_left(self._telling, start)
        return self._telling[number] if number < len(self._telling) else len(self.block)

    def told_until(self, start: int) -> int:
        """The first frame from a place on that has no data: a remote or an error frame."""
        number = bisect_left(self._untold, start)
        return self._untold[number] if number < len(self._untold) else len(self.block)

    def within(self, key: int, start: int, stop: int) -> Places:
        """The places of a message's frames in a range."""
        places = self.of.get(key, np.zeros(0, dtype=np.intp))
        first, last = np.searchsorted(places, (start, stop))
        return places[first:last]


def foresee(decoder: CanDecoder, of: BlockPlaces, start: int, stop: int) -> Stretch | None:
    """The longest stretch from `start` on, or None."""
    while stop - start >= MIN_FRAMES:
        try:
            return _Try(decoder, of, start, stop).stretch()
        except Odd as odd:
            stop = odd.place
    return None


class _Try:
    """Decodes a range; raises `Odd` with the first place that has to end it."""

    def __init__(self, decoder: CanDecoder, of: BlockPlaces, start: int, stop: int) -> None:
        self._decoder = decoder
        self._of = of
        self._start, self._stop = start, stop
        self._odd = stop
        self._settle: list[Settle] = []
        self._groups: list[Frames] = []
        self._wheels: list[Angles] = []
        self._readings: list[Values] = []
        self._held: dict[int, tuple[Places, NDArray[np.bool_]]] = {}
        """Condition -> frames that told it, and whether it held."""

    def stretch(self) -> Stretch:
        """All groups of all messages."""
        messages = [
            (plan, groups, self._of.within(key, self._start, self._stop))
            for key, (plan, groups) in self._decoder.plans.items()
        ]
        for plan, _, places in messages:
            for condition in plan.conditions:
                self._compare(condition, places)
        relevant = 0
        for plan, groups, places in messages:
            relevant += len(places)
            for group in groups:
                self._take(plan, group, places)
        if self._odd < self._stop:
            raise Odd(self._odd)
        found = tuple(self._groups), tuple(self._wheels), tuple(self._readings)
        return Stretch(self._start, self._stop, *found, self._settler(relevant))

    def _settler(self, relevant: int) -> Settle:
        decoder, steps, frames = self._decoder, self._settle, self._stop - self._start

        def settle() -> None:
            for step in steps:
                step()
            decoder.counts["frames"] += frames
            if frames > relevant:
                decoder.counts["ignored"] += frames - relevant
            decoder.forget_calm()

        return settle

    def _found_odd(self, place: int) -> None:
        self._odd = min(self._odd, place)

    # -- bits ------------------------------------------------------------------------------------------------

    def _present(self, selectors: tuple[tuple[BitField, frozenset[int]], ...], places: Places) -> Places:
        """The frames that hold a branch of the multiplexers."""
        for field, values in selectors:
            fits = self._of.block.size[places] >= field.min_bytes
            places = places[fits]
            places = places[np.isin(numbers(field, self._bits(field, places)), list(values))]
        return places

    def _bits(self, field: BitField, places: Places) -> RawArray:
        try:
            return raw_bits(field, self._of.block.data[places])
        except ValueError:  # no frame of the block is so long
            return np.zeros(len(places), dtype=np.uint64)

    def _compare(self, condition: ConditionPlan, places: Places) -> None:
        """When a comparison held."""
        places = self._present(condition.selectors, places)
        places = places[self._of.block.size[places] >= condition.field.min_bytes]
        told, back = np.unique(self._bits(condition.field, places), return_inverse=True)
        holds = np.array([condition.holds(int(bits)) for bits in told], dtype=bool)[back]
        self._held[condition.number] = places, holds
        if len(places):
            self._settle.append(lambda: self._decoder.holds.__setitem__(condition.number, bool(holds[-1])))

    def _holds(self, number: int, places: Places) -> NDArray[np.bool_]:
        """Whether a condition holds at each frame, as its message last told."""
        told, holds = self._held[number]
        before = self._decoder.holds.get(number, False)
        return np.append(holds, before)[np.searchsorted(told, places, side="right") - 1]

    # -- a group of signals ----------------------------------------------------------------------------------

    def _take(self, plan: MessagePlan, group: Group, places: Places) -> None:
        block = self._of.block
        places = self._present(group.plan.selectors, places)
        time_s = block.time_s[places]
        raw = [self._bits(signal.field, places) for signal in group.plan.signals]
        values = [
            None if signal.modulus else self._values(signal, bits, places)
            for signal, bits in zip(group.plan.signals, raw, strict=True)
        ]
        unusable = self._unusable(group, places, raw, values)
        if unusable.any():
            self._found_odd(int(places[np.argmax(unusable)]))
        frames = Frames(places, time_s)
        period_s = self._arrivals(group, frames, values)
        # Stamps behind an odd frame need not rise, and trackers are asked about rising ones alone.
        sound = slice(int(np.searchsorted(places, self._odd)))
        places, time_s, period_s = places[sound], time_s[sound], period_s[sound]
        raw = [bits[sound] for bits in raw]
        values = [None if value is None else value[sound] for value in values]
        if len(places) == 0:
            return
        frames = Frames(places, time_s)
        self._groups.append(frames)
        evens: list[Even] = []
        for number, signal in enumerate(group.plan.signals):
            tracker = group.fields[number][5]
            value = values[number]
            if isinstance(tracker, WheelCounter):
                even = even_counts(tracker, time_s, self._counts(signal, raw[number], places), period_s)
            elif isinstance(tracker, WheelSpeedIntegrator):
                assert value is not None
                even = even_speeds(tracker, time_s, value, period_s)
            else:
                assert value is not None
                self._readings.append(Values(len(self._groups) - 1, value, signal.role))
                continue
            if even.odd < len(places):
                self._found_odd(int(places[even.odd]))
            self._rotations(tracker, frames, even)
            evens.append(even)
        if group.frozen is not None:
            self._frozen(group, places, time_s, dict(zip(group.trackers, evens, strict=True)), values)

    def _unusable(
        self, group: Group, places: Places, raw: list[RawArray], values: list[FloatArray | None]
    ) -> NDArray[np.bool_]:
        """Frames with a signal that is short, invalid, not qualified or no number, shape of `places`."""
        if any(group.doubted) or group.watch.uneasy:
            return np.ones(len(places), dtype=bool)
        found = np.zeros(len(places), dtype=bool)
        for signal, bits, value in zip(group.plan.signals, raw, values, strict=True):
            found |= self._of.block.size[places] < signal.field.min_bytes
            if signal.invalid:
                found |= np.isin(bits, np.array(sorted(signal.invalid), dtype=np.uint64))
            if signal.modulus:
                found |= bits >= np.uint64(signal.modulus)
            if signal.valid_when is not None:
                found |= ~self._holds(signal.valid_when, places)
            if value is not None:
                found |= ~np.isfinite(value)
        return found

    def _values(self, signal: SignalPlan, bits: RawArray, places: Places) -> FloatArray:
        value = signal.gain * numbers(signal.field, bits) + signal.bias
        if signal.wheel is not None and signal.backward_when is not None:
            value = np.where(self._holds(signal.backward_when, places), -value, value)
        return value

    def _counts(self, signal: SignalPlan, bits: RawArray, places: Places) -> NDArray[np.int64]:
        raw = bits.astype(np.int64)
        if signal.backward_when is None:
            return raw
        direction, backward = self._decoder.direction, self._holds(signal.backward_when, places)
        signed = direction.signed_all(signal.role, raw, signal.modulus, backward)
        self._settle.append(lambda: direction.put(signal.role, int(raw[-1]), int(signed[-1])))
        return signed

    def _arrivals(self, group: Group, frames: Frames, values: list[FloatArray | None]) -> FloatArray:
        """(n,) the message's period at each frame."""
        if group.arrival is None:
            raise Odd(self._start)
        arrival, watch = group.arrival.copied(), group.watch.copied()
        places, stamps = frames.places.tolist(), frames.time_s.tolist()
        periods = arrival.judge_even(stamps)
        compared = [
            (number, value.tolist())
            for number, value in enumerate(values)
            if value is not None and watch.compares[number]
        ]
        even = min(len(periods), watch.even(stamps, compared))
        if even < len(places):
            self._found_odd(places[even])
        self._watch_silence(group.arrival, places[:even], stamps[:even], periods[:even])
        if places:
            payload = self._of.block.payload(places[-1])

            def settle() -> None:
                arrival.judged_last(payload)
                group.arrival, group.watch = arrival, watch

            self._settle.append(settle)
        return np.array(periods + [0.0] * (len(places) - len(periods)))

    def _watch_silence(
        self, before: MessageArrival, places: list[int], stamps: list[float], periods: list[float]
    ) -> None:
        """The first frame of the range, of whatever message, at whose stamp this message is overdue.

        `before`: the arrival before the range; `places`, `stamps`, `periods`: of the message's frames in it,
        up to the first that is not even.
        """
        last_s = np.array([before.last_s, *stamps])
        timeout_s = np.array([before.timeout_s, *map(timeout_of, periods)])
        # A frame meets what is known before it.
        frames = np.diff([self._start, *(place + 1 for place in places), self._stop])
        silent_s = self._of.block.time_s[self._start : self._stop] - np.repeat(last_s, frames)
        overdue = silent_s > np.repeat(timeout_s, frames)
        if before.timed_out:
            overdue[: frames[0]] = False
        if overdue.any():
            self._found_odd(self._start + int(np.argmax(overdue)))

    def _frozen(
        self,
        group: Group,
        places: Places,
        time_s: FloatArray,
        evens: dict[WheelCounter | WheelSpeedIntegrator, Even],
        values: list[FloatArray | None],
    ) -> None:
        """Speeds that all stay the same to the last bit."""
        assert group.frozen is not None
        frozen = group.frozen.copied()
        since = np.full(len(places), -np.inf)
        for (_, _, _, _, _, tracker), value in zip(group.fields, values, strict=True):
            if isinstance(tracker, WheelSpeedIntegrator) and tracker in frozen.trackers:
                assert value is not None
                own = np.where(
                    np.abs(value * tracker.radius_m) > SETTINGS.frozen_mps,
                    evens[tracker].still_since_s,
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
            if frozen.take(stamp, still_s, speed_mps):
                self._found_odd(int(places[at]))
                return
        self._settle.append(lambda: setattr(group, "frozen", frozen))

    # -- out -------------------------------------------------------------------------------------------------

    def _rotations(self, tracker: WheelCounter | WheelSpeedIntegrator, frames: Frames, even: Even) -> None:
        quantum = tracker.rad_per_bit if isinstance(tracker, WheelCounter) else 0.0
        group = len(self._groups) - 1
        self._wheels.append(Angles(group, even.angle_rad, tracker.wheel, tracker.segment, quantum))
        heard_s, last_s = self._decoder.heard_s, float(frames.time_s[-1])
        self._settle.append(even.settle)
        self._settle.append(lambda: heard_s.__setitem__(tracker.wheel, last_s))
