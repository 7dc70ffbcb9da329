"""Unwrapping of one wheel's counter: exact angles, and every fault distinguished and rejected."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.sources_can.build import RADIUS_M, TEETH, rotations
from tpmsd.onboard.sources.can.faults import FaultLog
from tpmsd.onboard.sources.events import Event, RotationSample, SourceFault
from tpmsd.onboard.sources.wheel_counter import WheelCounter

PERIOD_S = 0.01
M_PER_COUNT = 2 * math.pi * RADIUS_M / TEETH


@dataclass
class Wheel:
    """A counter with what came out of it."""

    bits: int = 16
    counts_per_bit: float = 1.0

    def __post_init__(self) -> None:
        self.faults = FaultLog()
        self.counter = WheelCounter(2, 1 << self.bits, self.counts_per_bit, TEETH, RADIUS_M, self.faults)
        self.out: list[Event] = []

    def feed(self, time_s: float, total: int, period_s: float = PERIOD_S) -> list[RotationSample]:
        """Samples that the counter emits for a true total."""
        begin = len(self.out)
        self.counter.update(time_s, total % (1 << self.bits), period_s, self.out)
        return rotations(self.out[begin:])

    def drive(
        self, start_s: float, end_s: float, speed_mps: float, start: int = 0, period_s: float = PERIOD_S
    ) -> int:
        """Feed readings at a constant speed; the last total."""
        total = start
        for step in range(1, round((end_s - start_s) / period_s) + 1):
            total = start + math.floor(speed_mps * step * period_s / M_PER_COUNT / self.counts_per_bit)
            self.feed(start_s + step * period_s, total, period_s)
        return total


@st.composite
def drives(draw: st.DrawFn) -> tuple[int, int, list[tuple[float, int, str]]]:
    """Bits of the counter, its first raw value, and (time, true total, what happens to the frame)."""
    bits = draw(st.sampled_from([8, 10, 16, 32]))
    start = draw(st.integers(0, (1 << bits) - 1))
    speed = draw(st.floats(0.0, 50.0))
    distance_m, frames = 0.0, []
    quiet = 0
    for step in range(300):
        if step % 40 == 0:
            acceleration = draw(st.floats(-9.0, 6.0))
        speed = min(60.0, max(0.0, speed + acceleration * PERIOD_S))
        distance_m += speed * PERIOD_S
        fault = ""
        # Each fault stands alone, after enough readings to know the speed.
        if step > 20 and quiet <= 0 and draw(st.integers(0, 19)) == 0:
            fault = draw(st.sampled_from(["lost", "lost", "repeated", "late", "odd", "twice"]))
            quiet = 3
        quiet -= 1
        jitter_s = draw(st.sampled_from([0.0, 0.001, -0.001, 0.0025]))
        frames.append((step * PERIOD_S + jitter_s, math.floor(distance_m / M_PER_COUNT), fault))
    return bits, start, frames


@settings(derandomize=True, deadline=None, max_examples=60)
@given(drives(), st.data())
def test_no_fault_moves_an_angle(
    drive: tuple[int, int, list[tuple[float, int, str]]], data: st.DataObject
) -> None:
    """Whatever is lost, repeated, late or odd: angles at sound frames differ by the true counts exactly."""
    bits, start, frames = drive
    wheel = Wheel(bits)
    truth: dict[float, int] = {}
    before = frames[0][1]
    for time_s, total, fault in frames:
        if fault == "lost":
            continue
        if fault == "repeated":
            wheel.feed(time_s, start + before)
            continue
        if fault == "odd":
            wheel.feed(time_s, data.draw(st.integers(0, (1 << bits) - 1)))
            continue
        truth[time_s] = total
        wheel.feed(time_s, start + total)
        if fault == "twice":
            wheel.feed(time_s, start + total)
        elif fault == "late":
            wheel.feed(time_s - 0.015, start + before)
        before = total

    by_segment: dict[int, list[tuple[int, float]]] = {}
    for sample in rotations(wheel.out):
        if sample.time_s in truth:
            by_segment.setdefault(sample.segment, []).append((truth[sample.time_s], sample.angle_rad))
    for readings in by_segment.values():
        first_total, first_rad = readings[0]
        for total, angle_rad in readings:
            assert total - first_total == round((angle_rad - first_rad) / wheel.counter.rad_per_bit, 6)
    # And nearly all sound frames are used: a fault costs at most its neighbours.
    assert sum(map(len, by_segment.values())) >= 0.9 * len(truth)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.sampled_from([8, 10, 16, 32]), st.floats(0.0, 60.0), st.integers(0, 2**32))
def test_roll_over_is_exact_at_any_width(bits: int, speed_mps: float, start: int) -> None:
    """A counter of any width gives the true number of counts, in one segment, from any start value."""
    wheel = Wheel(bits)
    total = wheel.drive(0.0, 8.0, speed_mps, start)
    first, last = rotations(wheel.out)[0], rotations(wheel.out)[-1]
    first_total = start + math.floor(speed_mps * PERIOD_S / M_PER_COUNT)

    assert total - first_total == round((last.angle_rad - first.angle_rad) / (2 * math.pi / TEETH), 6)
    assert {0} == {sample.segment for sample in rotations(wheel.out)}
    assert {} == wheel.faults.counts


def test_half_counts_per_bit_halve_the_angle() -> None:
    """A scale of 0.5 (four 8-bit counters in one message) makes each bit half a count."""
    wheel = Wheel(8, 0.5)
    wheel.drive(0.0, 5.0, 20.0)
    first, last = rotations(wheel.out)[0], rotations(wheel.out)[-1]
    expected_bits = math.floor(20.0 * 5.0 / M_PER_COUNT / 0.5) - math.floor(
        20.0 * PERIOD_S / M_PER_COUNT / 0.5
    )

    assert math.pi / TEETH == last.quantum_rad
    assert math.isclose(expected_bits * math.pi / TEETH, last.angle_rad - first.angle_rad, rel_tol=1e-12)


def test_a_repeated_value_at_speed_is_not_a_reading() -> None:
    """The same value again, where at least two counts were due, gives no sample and is counted."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)

    assert [] == wheel.feed(1.01, total)
    assert 1 == wheel.faults.counts["rl.repeated"]
    assert [0] == [sample.segment for sample in wheel.feed(1.02, total + 10)]


def test_a_value_that_braking_can_leave_unchanged_is_a_reading() -> None:
    """At 150 counts/s a period of 10 ms moves 1.5 counts, 1.2 of them under the hardest braking: fewer than
    the two from which an unchanged value was not renewed."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 150.0 * M_PER_COUNT)

    assert 1 == len(wheel.feed(1.01, total))
    assert {} == wheel.faults.counts


def test_a_wheel_that_stops_impossibly_says_so_until_it_turns() -> None:
    """A value that stands still at speed is impossible; one that stands after braking is not."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)
    assert not wheel.counter.stopped_impossibly
    for step in range(1, 20):
        wheel.feed(1.0 + 0.01 * step, total)
    assert wheel.counter.stopped_impossibly
    standing = Wheel()
    for step in range(300):
        standing.feed(0.01 * step, 500)
    assert not standing.counter.stopped_impossibly


def test_the_same_value_of_a_creeping_wheel_is_a_reading() -> None:
    """Below a count per frame equal values are the rule, not a fault."""
    wheel = Wheel()
    wheel.drive(0.0, 2.0, 0.5)

    assert 200 == len(rotations(wheel.out))
    assert {} == wheel.faults.counts


def test_a_hard_stop_is_no_fault() -> None:
    """Full braking to a standstill at 10 m/s2 loses no reading of a fine encoder."""
    wheel = Wheel(32, TEETH / 40000)
    for step in range(400):
        time_s = step * PERIOD_S
        distance_m = 20.0 * time_s - 5.0 * time_s**2 if time_s < 2.0 else 20.0
        wheel.feed(time_s, math.floor(distance_m / M_PER_COUNT * 40000 / TEETH))

    assert 400 == len(rotations(wheel.out))
    assert {} == wheel.faults.counts


def test_a_late_reading_is_skipped() -> None:
    """A time stamp that is not after the last one used changes nothing."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)

    assert [] == wheel.feed(0.995, total - 3)
    assert 1 == wheel.faults.counts["rl.late"]


def test_a_single_odd_value_is_dropped() -> None:
    """An impossible value between two sound ones is one jump, and the segment goes on."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)

    assert [] == wheel.feed(1.01, total + 20000)
    (sample,) = wheel.feed(1.02, total + 10)
    assert (0, total + 10) == (sample.segment, round(sample.angle_rad * TEETH / (2 * math.pi)) + 5)
    assert {"rl.jump": 1} == dict(wheel.faults.counts)


def test_an_odd_value_within_reach_is_taken_back() -> None:
    """A wrong value that the wheel could have reached misleads one sample only, and breaks no segment."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)
    before = rotations(wheel.out)[-1]
    wheel.feed(1.01, total + 12)
    (sample,) = wheel.feed(1.02, total + 7)

    assert 0 == sample.segment
    assert math.isclose(7 * 2 * math.pi / TEETH, sample.angle_rad - before.angle_rad, rel_tol=1e-9)
    assert {"rl.jump": 1} == dict(wheel.faults.counts)


def test_an_odd_value_is_reported_at_its_own_stamp() -> None:
    """The fault lies where the value came that nothing before or after it bears out."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)
    wheel.feed(1.01, total + 20000)
    wheel.feed(1.02, total + 10)

    faults = [event for event in wheel.out if isinstance(event, SourceFault)]
    assert [(1.01, "jump", 2)] == [(fault.time_s, fault.kind, fault.wheel) for fault in faults]


def test_a_counter_of_which_nothing_came_is_not_stuck() -> None:
    """A wheel without a message must not keep the others' readings from being taken at once."""
    assert not Wheel().counter.stuck


def test_a_new_level_is_a_new_segment() -> None:
    """Where the readings go on from the odd value, it was a jump of the counter."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)

    assert [] == wheel.feed(1.01, total + 20000)
    (sample,) = wheel.feed(1.02, total + 20005)
    assert (1, 0.0) == (sample.segment, sample.angle_rad)
    assert {"rl.jump": 1} == dict(wheel.faults.counts)


def test_a_new_level_after_the_first_reading_is_a_new_segment() -> None:
    """The first reading itself may be the odd one: the second and the third, which agree, begin a segment."""
    wheel = Wheel()
    wheel.feed(0.0, 1000)

    assert [] == wheel.feed(0.01, 31000)
    (sample,) = wheel.feed(0.02, 31002)
    assert (1, 0.0) == (sample.segment, sample.angle_rad)


def test_even_readings_are_believed_against_the_speed_before() -> None:
    """After frozen frames that said 0, six readings in a row of a fast wheel begin a segment."""
    wheel = Wheel()
    wheel.drive(0.0, 1.0, 0.0)

    wheel.drive(1.0, 1.05, 60.0)
    assert 0 == wheel.counter.segment
    wheel.drive(1.05, 1.15, 60.0, start=math.floor(0.05 * 60.0 / M_PER_COUNT))
    assert 1 == wheel.counter.segment


def test_even_readings_beyond_any_cars_speed_are_not_believed() -> None:
    """Six readings that agree on 300 m/s are no wheel's."""
    wheel = Wheel()
    wheel.drive(0.0, 1.0, 0.0)

    wheel.drive(1.0, 1.2, 300.0)
    assert 0 == wheel.counter.segment


def test_sparse_odd_readings_are_not_believed() -> None:
    """Readings further apart than the time over which a speed is taken do not agree, however even."""
    wheel = Wheel()
    wheel.drive(0.0, 1.0, 0.0)

    wheel.drive(1.0, 2.6, 60.0, period_s=0.2)
    assert 0 == wheel.counter.segment


def test_odd_readings_whose_stamps_go_back_are_not_believed() -> None:
    """Values that rise evenly are those of a wheel in the order of time alone, and no two of them at once."""
    for stamps_s, segment in (((1.03, 1.04), 1), ((1.04, 1.03), 0), ((1.03, 1.03), 0)):
        wheel = Wheel()
        wheel.drive(0.0, 1.0, 0.0)
        for step, time_s in enumerate((1.01, 1.02, *stamps_s, 1.05, 1.06, 1.07), 1):
            wheel.feed(time_s, 15 * step)
        assert segment == wheel.counter.segment


def test_odd_readings_among_sound_ones_are_not_believed() -> None:
    """Two frames of another counter after each sound one never make six in a row."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 5.0)

    for step in range(1, 91):
        if step % 3 == 0:
            wheel.feed(1.0 + step * PERIOD_S, total + math.floor(5.0 * step * PERIOD_S / M_PER_COUNT))
        else:
            wheel.feed(1.0 + step * PERIOD_S, 20000 + math.floor(60.0 * step * PERIOD_S / M_PER_COUNT))
    assert 0 == wheel.counter.segment


def test_a_missing_frame_before_the_speed_is_known_begins_a_segment() -> None:
    """One period of a small counter has one answer, two have several."""
    for interval_s, segment in ((0.1, 0), (0.2, 1)):
        wheel = Wheel(bits=8)
        wheel.feed(0.0, 0, 0.1)
        (sample,) = wheel.feed(interval_s, 100, 0.1)
        assert segment == sample.segment


def test_a_reset_is_a_new_segment() -> None:
    """A counter that falls to near zero and goes on from there was reset."""
    wheel = Wheel()
    wheel.drive(0.0, 1.0, 20.0, start=30000)

    assert [] == wheel.feed(1.01, 2)
    (sample,) = wheel.feed(1.02, 7)
    assert (1, 0.0) == (sample.segment, sample.angle_rad)
    (sample,) = wheel.feed(1.03, 12)
    assert math.isclose(5 * 2 * math.pi / TEETH, sample.angle_rad)
    assert {"rl.reset": 1} == dict(wheel.faults.counts)


def test_a_low_level_beyond_reach_is_a_jump() -> None:
    """A new level that no wheel could have counted to since zero is a jump; so is one that is not low."""
    for bits, level in ((16, 400), (8, 100)):
        wheel = Wheel(bits)
        total = wheel.drive(0.0, 1.0, 2.0, start=0 if bits == 8 else 30000)
        at_s = 1.01 if bits == 16 else 1.15
        raw = level if bits == 16 else total - total % 256 + 256 + level
        assert [] == wheel.feed(at_s, raw)
        (sample,) = wheel.feed(at_s + 0.01, raw + 1)
        assert (1, 0.0) == (sample.segment, sample.angle_rad)
        assert {"rl.jump": 1} == dict(wheel.faults.counts)


def test_a_plausible_gap_keeps_the_segment() -> None:
    """A second without frames on a 16-bit counter has one answer only."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)
    last = rotations(wheel.out)[-1]
    (sample,) = wheel.feed(2.0, total + 510)

    assert last.segment == sample.segment
    assert math.isclose(510 * 2 * math.pi / TEETH, sample.angle_rad - last.angle_rad, rel_tol=1e-9)


def test_roll_overs_in_a_gap_are_resolved_from_the_speed_before() -> None:
    """An 8-bit counter that rolled over in a gap goes on with the count that fits the speed."""
    wheel = Wheel(8)
    total = wheel.drive(0.0, 1.0, 40.0)
    last = rotations(wheel.out)[-1]
    gone = math.floor(0.3 * 40.0 / M_PER_COUNT)
    assert gone > 256  # the gap hides a whole turn of the counter

    assert [] == wheel.feed(1.3, total + gone)
    held, following = wheel.feed(1.31, total + gone + 10)
    assert [1.3, 1.31] == [held.time_s, following.time_s]
    assert last.segment == held.segment == following.segment
    assert math.isclose(gone * 2 * math.pi / TEETH, held.angle_rad - last.angle_rad, rel_tol=1e-9)


def test_a_gap_with_several_answers_begins_a_segment() -> None:
    """An 8-bit counter after two seconds of silence could have rolled over any number of times."""
    wheel = Wheel(8)
    total = wheel.drive(0.0, 1.0, 40.0)
    (sample,) = wheel.feed(3.0, total + 2037)

    assert (1, 0.0) == (sample.segment, sample.angle_rad)


def test_a_backlog_after_a_gap_is_not_taken_for_roll_overs() -> None:
    """Frames that were held up come in a bunch: the count of roll-overs from their times would be wrong."""
    wheel = Wheel(8)
    total = wheel.drive(0.0, 1.0, 40.0)
    # The time stamps say 0.27 s, in which 275 counts were due; it was 0.02 s, and 19 counts.
    assert [] == wheel.feed(1.27, total + 19)
    (sample,) = wheel.feed(1.2705, total + 29)

    assert (1, 0.0) == (sample.segment, sample.angle_rad)


def test_a_long_silence_begins_a_segment() -> None:
    """After more than a minute nobody knows whether the counter was reset in between."""
    wheel = Wheel(32)
    total = wheel.drive(0.0, 1.0, 20.0)
    (sample,) = wheel.feed(62.0, total + 10)

    assert 1 == sample.segment


def test_a_counter_that_counts_down_is_followed() -> None:
    """An encoder that knows its direction goes back past zero with the wheel."""
    wheel = Wheel(32)
    for step in range(300):
        wheel.feed(step * PERIOD_S, -step)

    samples = rotations(wheel.out)
    assert {0} == {sample.segment for sample in samples}
    assert math.isclose(-299 * 2 * math.pi / TEETH, samples[-1].angle_rad, rel_tol=1e-12)


def test_a_clock_step_begins_a_segment() -> None:
    """After `restart` the next reading is an origin again."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)
    wheel.counter.restart()
    (sample,) = wheel.feed(0.2, total + 5)

    assert (1, 0.0) == (sample.segment, sample.angle_rad)


def test_coarse_jitter_of_the_time_stamps_is_no_fault() -> None:
    """Frames that come in bunches of ten, as over a busy USB adapter, keep their angle and segment."""
    wheel = Wheel()
    for step in range(1, 1000):
        bunch_s = math.ceil(step / 10) * 0.1 + ((step - 1) % 10) * 0.0002
        wheel.feed(bunch_s, math.floor(30.0 * step * PERIOD_S / M_PER_COUNT))

    samples = rotations(wheel.out)
    assert {0} == {sample.segment for sample in samples}
    assert {} == dict(wheel.faults.counts)
    expected = math.floor(30.0 * 9.99 / M_PER_COUNT) - math.floor(30.0 * PERIOD_S / M_PER_COUNT)
    assert expected == round(samples[-1].angle_rad * TEETH / (2 * math.pi))


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.data())
def test_each_reset_and_each_jump_is_one_segment_and_one_count(data: st.DataObject) -> None:
    """However often the counter restarts near zero or leaps far while the car drives, segments are exact."""
    bits = data.draw(st.sampled_from([16, 32]))
    modulus = 1 << bits
    wheel = Wheel(bits)
    speed_mps = data.draw(st.floats(1.0, 60.0))
    breaks = data.draw(st.sets(st.sampled_from(range(30, 390, 12)), max_size=6))
    offset = data.draw(st.integers(0, modulus - 1))
    made = {"reset": 0, "jump": 0}
    truth: dict[float, int] = {}
    for step in range(400):
        time_s, total = step * PERIOD_S, math.floor(speed_mps * step * PERIOD_S / M_PER_COUNT)
        if step in breaks:
            # From far away to zero, or from near zero far away: what a wheel cannot have turned.
            if modulus // 4 < (offset + total) % modulus < 3 * modulus // 4:
                offset = data.draw(st.integers(0, 3)) - total
                made["reset"] += 1
            else:
                offset = modulus // 2 + data.draw(st.integers(0, 99)) - total
                made["jump"] += 1
        truth[time_s] = total
        wheel.feed(time_s, offset + total)

    samples = rotations(wheel.out)
    assert made == {kind: wheel.faults.counts[f"rl.{kind}"] for kind in made}
    assert list(range(len(breaks) + 1)) == sorted({sample.segment for sample in samples})
    assert 400 - len(breaks) == len(samples)
    for segment in range(len(breaks) + 1):
        angles = [(truth[s.time_s], s.angle_rad) for s in samples if s.segment == segment]
        turned = round((angles[-1][1] - angles[0][1]) / wheel.counter.rad_per_bit, 6)
        assert angles[-1][0] - angles[0][0] == turned


def test_a_reading_of_the_same_instant_is_late_and_changes_nothing() -> None:
    """A second reading with the stamp of the first is `late`; the angle goes on as if it had not come."""
    wheel, other = Wheel(), Wheel()
    for one in (wheel, other):
        one.drive(0.0, 1.0, 20.0)
    time_s, total = wheel.counter._time_s, wheel.counter._raw
    assert total is not None
    before = wheel.faults.counts.copy()
    assert [] == wheel.feed(time_s, total + 1)

    assert 1 == sum(wheel.faults.counts.values()) - sum(before.values())
    assert (time_s, total) == (wheel.counter._time_s, wheel.counter._raw)


def test_a_value_that_goes_on_behind_repeated_ones_keeps_its_segment() -> None:
    """At 20 m/s the same value for 400 ms, then all that the wheel has turned since: the frames between were
    old, and the time is that since the last that was not."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)
    for step in range(1, 40):
        assert [] == wheel.feed(1.0 + 0.01 * step, total)
    turned = math.floor(20.0 * 0.4 / M_PER_COUNT)
    (sample,) = wheel.feed(1.4, total + turned)

    assert 0 == sample.segment
    before = rotations(wheel.out)[-2]
    assert math.isclose(turned * 2 * math.pi / TEETH, sample.angle_rad - before.angle_rad, rel_tol=1e-9)


def test_a_value_that_stays_for_minutes_is_no_gap() -> None:
    """A wheel at speed whose value froze, frame by frame: longer than a minute, and no segment begins."""
    wheel = Wheel()
    total = wheel.drive(0.0, 1.0, 20.0)
    for second in range(2, 130):
        wheel.feed(float(second), total)

    assert {0} == {sample.segment for sample in rotations(wheel.out)}
    assert 128 == wheel.faults.counts["rl.repeated"]
