"""From what is read to what the pipeline is given: order, stamps, steps of the clock, recording."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.daemon.fakes import wheels_frame
from tpmsd.onboard.daemon.frame_stamps import FrameStamps
from tpmsd.onboard.daemon.input_queue import InputQueue
from tpmsd.onboard.sources.drive import Sentence


def stamps(items: object) -> list[float]:
    return [item.time_s for item in items]  # type: ignore[attr-defined]


def on_host(adapter: FrameStamps, stamp_s: float, now_s: float) -> float:
    """The stamp on the host's clock of a frame that was read alone."""
    return stamp_s + adapter.offset_s([stamp_s], now_s)


@settings(derandomize=True, deadline=None)
@given(
    frames=st.lists(st.floats(100.0, 101.0), max_size=30),
    lines=st.lists(st.floats(100.0, 101.0), max_size=10),
    until_s=st.floats(99.9, 101.1),
)
def test_inputs_come_out_in_the_order_of_their_stamps(
    frames: list[float], lines: list[float], until_s: float
) -> None:
    """What was read in any order is released sorted, up to the time asked for, and nothing is lost."""
    queue = InputQueue()
    for stamp_s in frames:
        queue.put_frame(wheels_frame(stamp_s), stamp_s, 101.0)
    for stamp_s in lines:
        queue.put_sentence(b"$GNRMC", stamp_s)

    first = stamps(queue.release(until_s))
    rest = stamps(queue.release(math.inf))

    assert sorted(first) == first
    assert all(stamp_s <= until_s for stamp_s in first)
    assert all(stamp_s > until_s for stamp_s in rest)
    kept = sorted(round(stamp_s, 6) for stamp_s in frames + lines)
    assert len(kept) == len(first) + len(rest) + queue.counts["late"]


def test_frames_go_before_sentences_of_the_same_microsecond() -> None:
    """At equal stamps the order is that of a replay: the bus first."""
    queue = InputQueue()
    queue.put_sentence(b"$GNRMC", 100.0)
    queue.put_frame(wheels_frame(100.0000001), 100.0000001, 100.0)

    assert ["CanFrame", "Sentence"] == [type(item).__name__ for item in queue.release(100.0)]


def test_stamps_are_those_that_a_recording_holds() -> None:
    """A stamp is rounded to microseconds at the door, so that live and replay reckon with the same number."""
    queue = InputQueue()
    queue.put_sentence(b"$GNRMC", 1719820800.12345678)

    assert [Sentence(1719820800.123457, b"$GNRMC", 0)] == list(queue.release(math.inf))


def test_a_full_queue_drops_the_oldest_and_counts() -> None:
    """Memory is bounded: beyond the capacity the oldest inputs go."""
    queue = InputQueue(capacity=3)
    for stamp_s in (100.0, 101.0, 102.0, 103.0, 104.0):
        queue.put_sentence(b"$GNRMC", stamp_s)

    assert 3 == len(queue)
    assert 2 == queue.counts["overflow"]
    assert [102.0, 103.0, 104.0] == stamps(queue.release(math.inf))


def test_a_straggler_is_used_but_not_one_that_looks_like_a_step_of_the_clock() -> None:
    """A frame 0.3 s behind the others still counts; one 0.5 s behind is dropped and counted."""
    queue = InputQueue()
    list(queue.release(100.0))
    for stamp_s in (99.5, 99.7):
        queue.put_frame(wheels_frame(stamp_s), stamp_s, 100.0)

    assert [99.7] == stamps(queue.release(100.0))
    assert 1 == queue.counts["late"]


def test_stamps_of_a_strange_clock_are_replaced() -> None:
    """A frame stamped in seconds since boot is taken to be of now, and counted; so is one without a stamp."""
    queue = InputQueue()
    for stamp_s in (12.5, math.nan):
        queue.put_frame(wheels_frame(stamp_s), stamp_s, 1719820800.0)

    assert [1719820800.0] * 2 == stamps(queue.release(math.inf))
    assert 2 == queue.counts["bad_stamp"]


def test_what_came_before_a_backward_step_goes_first() -> None:
    """When the host's clock is set back, inputs stamped before that do not wait for their time again."""
    queue = InputQueue()
    for stamp_s in (5000.02, 1000.01, 5000.01):
        queue.put_sentence(b"$GNRMC", stamp_s)
    list(queue.release(999.0))

    assert [5000.01, 5000.02] == stamps(queue.release_at_clock_step(1000.02))
    assert [1000.01] == stamps(queue.release(1000.02))


def test_an_adapters_own_clock_is_brought_onto_the_hosts() -> None:
    """Stamps since boot, read up to 30 ms late, keep their distances to the microsecond on host time."""
    adapter, host_s = FrameStamps(), 1.7e9
    lags_s = [0.004, 0.030, 0.001, 0.012, 0.002] * 40
    out = [on_host(adapter, 77.0 + 0.02 * k, host_s + 0.02 * k + lag) for k, lag in enumerate(lags_s)]

    settled = out[5:]
    steps = [later - earlier for earlier, later in pairwise(settled)]
    assert steps == pytest.approx([0.02] * len(steps), abs=1e-6)
    # The least lag seen is 1 ms, and up to 50 ms is left as it is.
    assert out[-1] == pytest.approx(host_s + 0.02 * 199 + 0.001 - 0.05, abs=1e-6)


def test_a_drifting_adapter_is_followed() -> None:
    """A crystal 50 ppm slow would be 0.9 s behind after five hours; it stays within the tolerance."""
    adapter = FrameStamps()
    lag_s = 0.0
    for k in range(18_000):
        true_s = 1.7e9 + k
        lag_s = true_s - on_host(adapter, true_s - 50e-6 * k, true_s + 0.002)

    assert 0.0 < lag_s < 0.052


def test_stamps_of_the_hosts_own_clock_are_left_alone() -> None:
    """Where stamps are the host's, nothing is corrected, also not while the process is busy for a second."""
    adapter = FrameStamps()
    stamps_s = [1000.0 + 0.01 * k for k in range(300)]
    reads_s = [s + (0.9 if 100 <= k < 190 else 0.003) for k, s in enumerate(stamps_s)]

    assert stamps_s == [on_host(adapter, s, read_s) for s, read_s in zip(stamps_s, reads_s, strict=True)]


@pytest.mark.parametrize(("ahead_s", "bad"), [(60.0, 0), (-60.0, 0), (60.01, 1), (-60.01, 1)])
def test_a_stamp_of_another_clock_is_a_minute_off(ahead_s: float, bad: int) -> None:
    """A stamp up to 60 s from the host's clock is kept; one beyond is replaced and counted."""
    queue = InputQueue()
    queue.put_frame(wheels_frame(1000.0 + ahead_s), 1000.0 + ahead_s, 1000.0)

    assert bad == queue.counts["bad_stamp"]
    assert [1000.0 if bad else 1000.0 + ahead_s] == stamps(queue.release(math.inf))


def test_after_a_backward_step_nothing_is_late() -> None:
    """Inputs on the new time, far before those that were released, are released too."""
    queue = InputQueue()
    queue.put_sentence(b"$GNRMC", 1000.0)
    assert [1000.0] == stamps(queue.release(1000.0))
    queue.release_at_clock_step(10.0)
    queue.put_sentence(b"$GNRMC", 10.1)

    assert [10.1] == stamps(queue.release(11.0))
    assert 0 == queue.counts["late"]


def test_inputs_of_one_stamp_keep_the_order_in_which_they_were_read() -> None:
    """Lines of one microsecond leave as they came, whatever their bytes."""
    queue = InputQueue()
    lines = [b"$C", b"$A", b"$D", b"$B"]
    for line in lines:
        queue.put_sentence(line, 5.0)

    released = list(queue.release(5.0))
    assert lines == [item.line for item in released if isinstance(item, Sentence)]


def test_what_is_stamped_at_the_very_time_of_a_step_stays_in_the_queue() -> None:
    """It lies not ahead of the clock, and is released with the inputs of the new time, once."""
    queue = InputQueue()
    for stamp_s in (10.0, 10.5):
        queue.put_sentence(b"$GNRMC", stamp_s)

    assert [10.5] == stamps(queue.release_at_clock_step(10.0))
    assert [10.0] == stamps(queue.release(11.0))


def test_the_room_is_for_fifty_thousand_inputs() -> None:
    """Half a minute of a busy bus; the one after it drops the oldest."""
    queue = InputQueue()
    for number in range(50_001):
        queue.put_sentence(b"$GNRMC", float(number))

    assert (50_000, 1) == (len(queue), queue.counts["overflow"])


@pytest.mark.parametrize(("behind_s", "late"), [(0.4, 0), (0.400001, 1)])
def test_an_input_is_late_beyond_four_tenths_of_a_second(behind_s: float, late: int) -> None:
    """At the tenths themselves it is used; time that was released once is not taken back by less."""
    queue = InputQueue()
    for until_s in (50.0, 1.0):
        list(queue.release(until_s))
    queue.put_sentence(b"$GNRMC", 50.0 - behind_s)

    assert 1 - late == len(list(queue.release(51.0)))
    assert late == queue.counts["late"]


def shifts(reads: list[tuple[float, float]], adapter: FrameStamps | None = None) -> list[float]:
    """What is added to stamps of an adapter, each given as the time of its reading and its lag."""
    adapter = adapter or FrameStamps()
    return [round(adapter.offset_s([now_s - lag_s], now_s), 9) for now_s, lag_s in reads]


@pytest.mark.parametrize(
    ("times_s", "remembered_s"),
    [
        ((0.0, 10.0, 20.0), 0.2),  # two windows later the first is forgotten
        ((0.0, 9.9, 19.8), 0.1),  # the second reading is of the first window, and the third of the next
        ((5.0, 5.0, 5.0), 0.1),
        ((5.0, 5.1, 5.2), 0.1),
        ((5.0, 4.5, 14.6), 0.2),  # the clock went back by half a second, which begins a window
    ],
)
def test_the_least_lag_is_remembered_for_one_to_two_windows_of_ten_seconds(
    times_s: tuple[float, ...], remembered_s: float
) -> None:
    """Of the lags 0.1, 0.2, 0.3 s the third stamp is corrected by the least still known but 50 ms."""
    reads = list(zip(times_s, (0.1, 0.2, 0.3), strict=True))
    assert remembered_s - 0.05 == pytest.approx(shifts(reads)[-1])


@pytest.mark.parametrize(
    ("lag_s", "shift_s"), [(-0.2, -0.2), (-0.01, -0.01), (0.0, 0.0), (0.05, 0.0), (0.06, 0.01), (5.0, 4.95)]
)
def test_a_stamp_is_never_left_ahead_of_the_clock(lag_s: float, shift_s: float) -> None:
    """One from the future is brought to the reading; behind it 50 ms are left as they are, without a jump."""
    assert shift_s == pytest.approx(shifts([(1000.0, lag_s)])[0], abs=1e-9)


@settings(derandomize=True, deadline=None)
@given(
    lags_s=st.lists(st.integers(-300, 300), min_size=1, max_size=30),
    before_s=st.none() | st.floats(-0.3, 0.3),
)
def test_frames_that_were_read_together_keep_their_distances(
    lags_s: list[int], before_s: float | None
) -> None:
    """However long reading takes, all are moved alike, by what the youngest asks for: none becomes late."""
    together, alone = FrameStamps(), FrameStamps()
    if before_s is not None:
        for adapter in (together, alone):
            on_host(adapter, 999.0 - before_s, 999.0)

    offset_s = together.offset_s([1000.0 - 1e-3 * lag for lag in lags_s], 1000.0)
    youngest_s = 1000.0 - 1e-3 * min(lags_s)
    assert offset_s == pytest.approx(on_host(alone, youngest_s, 1000.0) - youngest_s, abs=1e-12)


def test_another_adapter_begins_again() -> None:
    """After a reset no lag of before counts, also where the new window has just begun."""
    adapter = FrameStamps()
    assert [0.05] == shifts([(1000.0, 0.1)], adapter)
    adapter.reset()

    assert [0.35, 0.35] == shifts([(1000.1, 0.4), (1000.2, 0.5)], adapter)
