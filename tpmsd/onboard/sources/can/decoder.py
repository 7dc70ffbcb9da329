"""CAN frames to wheel angles and inertial readings, at bus speed.

In: frames of the bus in the order of their arrival (time stamp, identifier, data), and now and then the time.
Out: `RotationSample`, `InertialSample` and `SourceFault` events, and exact counts of all that was wrong.
Pure: no I/O, no clock; the same frames give the same events, live or from a recording.

One frame goes through five stages:

    MessagePlan      which bits are needed, and are they all there      'short', 'invalid'
    MessageArrival   is the frame new, and what is missing before it    'late', 'repeated', 'lost', 'timeout'
    SenderWatch      is it of the one true sender                       'spoofed'
    WheelCounter or WheelSpeedIntegrator: can the wheel have done that  'jump', 'reset', 'repeated'
    the wheels together: does one stand still while the others turn     'stuck'

`counts` has the keys 'frames', 'ignored' (identifiers that carry nothing needed), 'decode.short', and
'<wheel or role>.<kind>', for example 'fl.lost' or 'yaw_rate.timeout'.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

from cantools.database.can import Database

from tpmsd.car.config.model import WHEEL_COUNT_ROLES, Config
from tpmsd.onboard.sources.can.arrival import MIN_TIMEOUT_S, FrameVerdict, MessageArrival
from tpmsd.onboard.sources.can.databases import load_database
from tpmsd.onboard.sources.can.faults import FaultLog
from tpmsd.onboard.sources.can.senders import SenderWatch
from tpmsd.onboard.sources.can.signal_plan import (
    BUS_SHIFT,
    EXTENDED,
    ConditionPlan,
    MessagePlan,
    SignalGroup,
    SignalPlan,
    can_filters,
    compile_plans,
)
from tpmsd.onboard.sources.events import Event, InertialSample, RotationSample, SourceFault
from tpmsd.onboard.sources.wheel_counter import WheelCounter
from tpmsd.onboard.sources.wheel_direction import DirectionKeeper
from tpmsd.onboard.sources.wheel_speed import FrozenSpeeds, WheelSpeedIntegrator

__all__ = ["CanDecoder", "can_filters", "load_database"]

Tracker = WheelCounter | WheelSpeedIntegrator
_USE = FrameVerdict.USE

FRESH_S = 0.5
"""A wheel that was heard of within this time can show that another one stands."""
ALONE_STILL_S = 3.0
"""Without another wheel a constant counter stands only after this time: no car stops faster. Nor do
four wheels at once: where all stopped harder than they can, frames were frozen, or the wheels are locked."""


def _fault_origin(signal: SignalPlan) -> int | str:
    """Return the key under which a signal's faults are counted: its wheel, or its role."""
    return signal.role if signal.wheel is None else signal.wheel


class Group:
    """A signal group with its state."""

    __slots__ = ("arrival", "doubted", "fields", "frozen", "origins", "plan", "trackers", "watch")

    def __init__(self, plan: SignalGroup, trackers: dict[str, Tracker]) -> None:
        self.plan = plan
        self.arrival: MessageArrival | None = None
        self.trackers = tuple(trackers[signal.role] for signal in plan.signals if signal.role in trackers)
        self.fields = tuple(
            (field.min_bytes, field.big_endian, field.shift, field.mask, signal, trackers.get(signal.role))
            for signal, field in ((signal, signal.field) for signal in plan.signals)
        )
        """Values that the loop over a frame's signals needs, without looking them up for each frame."""
        self.origins = tuple(_fault_origin(signal) for signal in plan.signals)
        """Keys under which faults of the message are counted: its wheels and roles."""
        # Counters tell two senders by their jumps; of speeds the steps from frame to frame are compared.
        steps = (
            signal.gain if isinstance(trackers.get(signal.role), WheelSpeedIntegrator) else None
            for signal in plan.signals
        )
        self.watch = SenderWatch(tuple(steps))
        fine = (
            tracker
            for signal in plan.signals
            if isinstance(tracker := trackers.get(signal.role), WheelSpeedIntegrator)
            and tracker.shows_noise(signal.gain)
        )
        speeds = tuple(fine)
        self.frozen = FrozenSpeeds(speeds) if len(speeds) > 1 else None
        """Detector of frozen speeds, if they are several and so fine that they cannot all stay the same."""
        self.doubted = [False] * len(self.fields)
        """Flags per signal: True if its last reading was rejected for want of a single sender."""


class _OtherTravel:
    """State of the other wheels when a wheel's value stopped changing."""

    __slots__ = ("others", "since_s")

    def __init__(self, since_s: float, others: list[tuple[Tracker, float, float]]) -> None:
        self.since_s = since_s
        self.others = others


class CanDecoder:
    """Decodes the frames of one bus."""

    def __init__(self, config: Config, database: Database) -> None:
        self._faults = FaultLog()
        self.counts: Counter[str] = self._faults.counts
        self._trackers: dict[str, Tracker] = {}
        plans = compile_plans(config, database)
        for plan in plans.values():
            for group in plan.groups:
                for signal in group.signals:
                    if signal.wheel is not None:
                        self._trackers[signal.role] = self._make_tracker(config, signal, signal.wheel)
        self.plans: dict[int, tuple[MessagePlan, tuple[Group, ...]]] = {
            key: (plan, tuple(Group(group, self._trackers) for group in plan.groups))
            for key, plan in plans.items()
        }
        self._groups = [group for _, groups in self.plans.values() for group in groups]
        self._wheels = list(self._trackers.values())
        self.received_s = dict.fromkeys((tracker.wheel for tracker in self._wheels), -math.inf)
        self._other_travel: dict[int, _OtherTravel] = {}
        self.holds: dict[int, bool] = {}
        """State of each condition when its message last came; none before that."""
        self.direction = DirectionKeeper()
        self._polled_s = self._calm_until_s = -math.inf
        """Interval in which no message can become overdue."""

    def _make_tracker(self, config: Config, signal: SignalPlan, wheel: int) -> Tracker:
        """Return the tracker of a wheel's signal: of a counter or of a speed."""
        vehicle = config.vehicle
        radius_m = vehicle.wheel_radius_m[wheel]
        if signal.role in WHEEL_COUNT_ROLES:
            return WheelCounter(
                wheel, signal.modulus, signal.gain, vehicle.teeth_per_rev, radius_m, self._faults
            )
        return WheelSpeedIntegrator(wheel, radius_m, self._faults)

    def decode(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
    ) -> list[Event]:
        """Return events of one data frame (remote and error frames carry no data: do not pass them).

        `time_s`: host time stamp. CAN FD frames are decoded like classic ones.
        `bus`: 0 for the bus of [can], else the number of the further bus.
        """
        self.counts["frames"] += 1
        key = arbitration_id | EXTENDED if is_extended else arbitration_id
        entry = self.plans.get(bus << BUS_SHIFT | key if bus else key)
        out: list[Event] = []
        if entry is None:
            self.counts["ignored"] += 1
            return out
        plan, groups = entry
        size = len(data)
        little_bytes, big_bytes = plan.little_bytes, plan.big_bytes
        little = int.from_bytes(data if size <= little_bytes else data[:little_bytes], "little")
        if not big_bytes:
            big = 0
        elif size < big_bytes:
            big = int.from_bytes(data, "big") << 8 * (big_bytes - size)
        else:
            big = int.from_bytes(data[:big_bytes], "big")
        for condition in plan.conditions:
            self._evaluate_condition(condition, size, little, big)
        for group in groups:
            for field, numbers in group.plan.selectors:
                bits = (big if field.big_endian else little) >> field.shift & field.mask
                if field.min_bytes > size or field.number(bits) not in numbers:
                    break
            else:
                self._decode_group(time_s, group, data, little, big, out)
        return out

    def ignores(self, arbitration_id: int, is_extended: bool, bus: int = 0) -> bool:
        """Return whether nothing is decoded of frames of this identifier."""
        key = arbitration_id | EXTENDED if is_extended else arbitration_id
        return (bus << BUS_SHIFT | key if bus else key) not in self.plans

    def count_ignored(self, frames: int = 1) -> None:
        """Count frames that were not given to `decode` because it decodes nothing of them."""
        self.counts["frames"] += frames
        self.counts["ignored"] += frames

    def none_overdue(self, time_s: float) -> bool:
        """Return whether no message can be overdue at this time: `poll` would return nothing."""
        return self._polled_s <= time_s < self._calm_until_s

    def _evaluate_condition(self, condition: ConditionPlan, size: int, little: int, big: int) -> None:
        """Keep whether a condition holds by a frame's bytes, read as an integer in both byte orders; nothing
        in another branch."""
        bits = 0
        for field, numbers in (*condition.selectors, (condition.field, None)):
            bits = (big if field.big_endian else little) >> field.shift & field.mask
            if field.min_bytes > size or (numbers is not None and field.number(bits) not in numbers):
                return
        self.holds[condition.number] = condition.holds(bits)

    @property
    def all_rolling(self) -> bool:
        """True if the values of all wheels change from reading to reading."""
        return all(tracker.still_since is None and not tracker.stuck for tracker in self._wheels)

    @property
    def all_at_rest(self) -> bool:
        """True if all wheels are counted and stand, and none has rolled since another one stopped: nothing is
        judged of them as long as no value changes."""
        return all(
            isinstance(tracker, WheelCounter) and tracker.at_standstill and self._none_rolled_since(tracker)
            for tracker in self._wheels
        )

    def _none_rolled_since(self, tracker: WheelCounter) -> bool:
        """Return whether no other wheel has rolled since this one stopped."""
        travel = self._other_travel.get(tracker.wheel)
        return (
            travel is not None
            and travel.since_s == tracker.still_since
            and not any(tracker.has_rolled(other.travel_m - travel_m) for other, travel_m, _ in travel.others)
        )

    @property
    def shared_faults(self) -> Counter[str]:
        """Excess of `counts`, summed over wheels and roles, over the number of faulty frames, by kind."""
        return self._faults.shared

    def recheck_timeouts(self) -> None:
        """Make the next frame check all messages for time-outs, after frames were decoded without `poll`."""
        self._polled_s = self._calm_until_s = -math.inf

    def note_clock_step(self) -> None:
        """Treat the next frame of each message as the first after a backward step of the host's clock, which
        the stamps of all inputs together have shown."""
        for group in self._groups:
            if group.arrival is not None:
                group.arrival.note_clock_step()

    def poll(self, time_s: float) -> list[Event]:
        """Return the faults of messages that have timed out by now; each is reported once, until the message
        is back."""
        out: list[Event] = []
        if self._polled_s <= time_s < self._calm_until_s:
            return out
        oldest_s = time_s
        for group in self._groups:
            arrival = group.arrival
            if arrival is None:
                arrival = group.arrival = MessageArrival(time_s)
            elif not arrival.timed_out and arrival.is_overdue(time_s):
                self._report_timeout(time_s, group, arrival, out)
            if not arrival.timed_out and arrival.last_s < oldest_s:
                oldest_s = arrival.last_s
        # Half of the shortest time-out there is: stamps are rounded, and time-outs become known later.
        self._polled_s, self._calm_until_s = time_s, oldest_s + 0.5 * MIN_TIMEOUT_S
        return out

    def _clear_timeout(self, arrival: MessageArrival) -> None:
        """Clear a message's time-out, for a frame came; with a late stamp it may be overdue again at once."""
        if arrival.timed_out:
            arrival.timed_out, self._calm_until_s = False, -math.inf

    def _decode_group(
        self, time_s: float, group: Group, data: bytes, little: int, big: int, out: list[Event]
    ) -> None:
        """Append the events of a group's signals; `little`, `big`: the frame's bytes as an integer in either
        order."""
        if not self._judge_arrival(time_s, group, data, out):
            return
        fast, size = group.watch.judge_frame(time_s), len(data)
        for number, (min_bytes, is_big, shift, mask, signal, tracker) in enumerate(group.fields):
            if min_bytes > size:
                self._note_short(time_s, signal, size, out)
                continue
            bits = (big if is_big else little) >> shift & mask
            if bits in signal.invalid or (
                signal.valid_when is not None and not self.holds.get(signal.valid_when, False)
            ):
                self._note_invalid(time_s, signal, bits, out)
            elif tracker is not None:
                self._decode_wheel(time_s, group, number, bits, fast, out)
            else:
                value = signal.gain * signal.field.number(bits) + signal.bias
                if not math.isfinite(value):
                    self._note_invalid(time_s, signal, bits, out)
                elif fast:
                    self._note_spoofed(time_s, group, number, out)
                else:
                    out.append(InertialSample(time_s, signal.role, value))

        if group.frozen is not None:
            for still in group.frozen.judge(time_s):
                self._faults.note(out, time_s, "stuck", still.wheel, f"{group.plan.name} is frozen")
                still.mark_stuck()

    def _judge_arrival(self, time_s: float, group: Group, data: bytes, out: list[Event]) -> bool:
        """Judge a frame by its stamp and report faults; return False for one that must not be used, say a
        repeated one."""
        arrival = group.arrival
        if arrival is None:
            arrival = group.arrival = MessageArrival(time_s)
        elif not arrival.timed_out and arrival.is_overdue(time_s):
            # Nobody polled in the silence; it was one all the same.
            self._report_timeout(time_s, group, arrival, out)
        verdict = arrival.judge(time_s, data)
        if verdict is not _USE:
            self._faults.note_message(out, time_s, verdict.name.lower(), group.origins)
            if verdict is not FrameVerdict.CLOCK_STEP:
                return False
            self._calm_until_s = -math.inf
            group.watch.restart(time_s)
            for wheel_tracker in group.trackers:
                wheel_tracker.restart()
        elif arrival.lost:
            self._faults.note_message(out, time_s, "lost", group.origins, group.plan.name, arrival.lost)
        self._clear_timeout(arrival)
        return True

    def _decode_wheel(
        self, time_s: float, group: Group, number: int, bits: int, fast: bool, out: list[Event]
    ) -> None:
        """Update a wheel by its signal's bits, unless the sender is doubted; `fast`: the message comes too
        often."""
        _, _, _, _, signal, tracker = group.fields[number]
        assert tracker is not None
        watch, doubted, begun, jumps = group.watch, group.doubted, len(out), self._faults.jumps
        value = self._update_tracker(time_s, group, signal, tracker, bits, out)
        if value is None:
            self._note_invalid(time_s, signal, bits, out)
            return
        jumped = self._faults.jumps != jumps
        irregular = False
        if jumped or watch.uneasy or watch.compares[number]:
            sound = len(out) > begun and isinstance(out[-1], RotationSample)
            irregular = watch.judge_value(number, value, jumped, sound)
        if fast or irregular:
            # The wheel is followed on, so that it is known when its values make sense again.
            out[begun:] = [event for event in out[begun:] if isinstance(event, SourceFault)]
            self._note_spoofed(time_s, group, number, out)
            doubted[number] = True
        elif doubted[number]:
            # What it counted meanwhile may be another's: what follows is a new segment.
            doubted[number] = False
            del out[begun:]
            tracker.restart()
        else:
            self.received_s[tracker.wheel] = time_s
            if tracker.still_since is not None and not tracker.stuck:
                self._judge_still(time_s, tracker, out)

    def _update_tracker(
        self,
        time_s: float,
        group: Group,
        signal: SignalPlan,
        tracker: Tracker,
        bits: int,
        out: list[Event],
    ) -> float | None:
        """Give a reading to its tracker; return the speed (0 for a counter), None where the bits are no valid
        number."""
        assert group.arrival is not None
        backward = signal.backward_when is not None and self.holds.get(signal.backward_when, False)
        if isinstance(tracker, WheelCounter):
            if bits >= signal.modulus:
                return None
            if signal.backward_when is not None:
                bits = self.direction.signed(signal.role, bits, signal.modulus, backward)
            tracker.update(time_s, bits, group.arrival.period_s, out)
            return 0.0
        value = signal.gain * signal.field.number(bits) + signal.bias
        if not math.isfinite(value):
            return None
        value = -value if backward else value
        tracker.update(time_s, value, group.arrival.period_s, out)
        return value

    def _note_spoofed(self, time_s: float, group: Group, number: int, out: list[Event]) -> None:
        """Report frames or values of more than one sender, of which the true one is not known."""
        detail = f"{group.plan.name}: {group.watch.detail or 'two values in turn'}"
        self._faults.note(out, time_s, "spoofed", group.origins[number], detail)

    def _note_short(self, time_s: float, signal: SignalPlan, size: int, out: list[Event]) -> None:
        """Report a frame that is too short for a signal."""
        self.counts["decode.short"] += 1
        self._faults.note(out, time_s, "short", _fault_origin(signal), f"{signal.signal}: {size} bytes")

    def _note_invalid(self, time_s: float, signal: SignalPlan, bits: int, out: list[Event]) -> None:
        """Report a signal whose bits are invalid, not qualified or no number."""
        self._faults.note(out, time_s, "invalid", _fault_origin(signal), f"{signal.signal} = {bits:#x}")

    def _report_timeout(self, time_s: float, group: Group, arrival: MessageArrival, out: list[Event]) -> None:
        """Report a message that has timed out, for each of its wheels and roles."""
        arrival.timed_out = True
        silent = f"silent for {time_s - arrival.last_s:.2f} s" if arrival.seen else "never seen"
        self._faults.note_message(out, time_s, "timeout", group.origins, f"{group.plan.name} {silent}")

    def _judge_still(self, time_s: float, tracker: Tracker, out: list[Event]) -> None:
        """Decide whether a wheel whose value does not change stands with the car or is stuck; it may stay
        open."""
        since_s = tracker.still_since
        assert since_s is not None
        travel = self._other_travel.get(tracker.wheel)
        if travel is None or travel.since_s != since_s:
            others = self._other_trackers(time_s, tracker)
            seen = [(other, other.travel_m, other.speed_mps) for other in others]
            self._other_travel[tracker.wheel] = _OtherTravel(since_s, seen)
            return
        # Only those that were heard of then and still are.
        fresh = [entry for entry in travel.others if time_s - self.received_s[entry[0].wheel] <= FRESH_S]
        distances_m = [other.travel_m - travel_m for other, travel_m, _ in fresh]
        if isinstance(tracker, WheelCounter):
            stuck = tracker.is_stuck(time_s, distances_m)
        else:
            changes_mps = [other.speed_mps - speed_mps for other, _, speed_mps in fresh]
            stuck = tracker.is_stuck(time_s, distances_m, changes_mps)
        if stuck:
            self._faults.note(out, time_s, "stuck", tracker.wheel, f"for {time_s - since_s:.1f} s")
            tracker.mark_stuck()
        elif stuck is False and (
            (fresh and not tracker.stopped_impossibly) or time_s - since_s > ALONE_STILL_S
        ):
            tracker.mark_standstill()

    def _other_trackers(self, time_s: float, tracker: Tracker) -> Iterator[Tracker]:
        """Yield the trackers of the other wheels that had a reading lately and are not stuck."""
        for other in self._wheels:
            if other is not tracker and not other.stuck and time_s - self.received_s[other.wheel] <= FRESH_S:
                yield other
