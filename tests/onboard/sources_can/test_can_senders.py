"""Whether a message has one sender: by its rate, and by values that cannot be of one wheel."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.sources_can.build import counter_decoder, counts_at, counts_frame, faults, rotations
from tpmsd.onboard.sources.can.senders import SenderWatch

PERIOD_S = 0.02


def watched(period_s: float = PERIOD_S, seconds: float = 20.0) -> tuple[SenderWatch, float]:
    """A watch that knows a sender's rate, and the time of its next frame."""
    watch = SenderWatch((None,))
    time_s = 100.0
    while time_s < 100.0 + seconds:
        assert not watch.judge_frame(time_s)
        time_s += period_s
    return watch, time_s


@pytest.mark.parametrize("factor", [1.5, 2.0, 10.0])
def test_more_frames_than_ever_are_noticed_and_forgiven(factor: float) -> None:
    """Half as many again are found within three seconds; at the old rate the message is good again soon."""
    watch, time_s = watched()
    begun_s = time_s
    while not watch.judge_frame(time_s):
        time_s += PERIOD_S / factor
        assert time_s < begun_s + 5.0
    assert time_s - begun_s < 1.2 / (factor - 1.25) + 0.2
    for _ in range(50):
        watch.judge_value(0, 0.0, jumped=True, sound=True)  # two senders: it is not accepted as a new rate
        watch.judge_frame(time_s := time_s + PERIOD_S / factor)
    quiet_s = time_s
    while watch.judge_frame(time_s):
        time_s += PERIOD_S
        assert time_s < quiet_s + 5.0


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.lists(st.integers(1, 25), min_size=30, max_size=60), st.floats(0.0, 0.2))
def test_frames_in_bunches_are_one_senders(bunches: list[int], extra: float) -> None:
    """However the frames of one sender are bunched, with a fifth of them sent twice: no doubt."""
    watch, time_s = watched()
    again = 0.0
    for size in bunches:
        time_s += size * PERIOD_S
        for number in range(size):
            assert not watch.judge_frame(time_s + 1e-5 * number)
            again += extra
            if again >= 1.0:
                again -= 1.0
                assert not watch.judge_frame(time_s + 1e-5 * number + 5e-6)


def test_a_sender_that_starts_slowly_is_known_by_its_fastest_rate() -> None:
    """The first seconds at a tenth of the rate do not make the rest suspicious."""
    watch = SenderWatch((None,))
    doubts = [watch.judge_frame(0.1 * k) for k in range(30)]
    doubts += [watch.judge_frame(3.0 + 0.01 * k) for k in range(3000)]
    assert not any(doubts)


def test_a_backlog_after_a_silence_is_no_second_sender() -> None:
    """Five seconds of frames that come at once after five seconds of nothing are borne."""
    watch, time_s = watched()
    time_s += 5.0
    assert not any(watch.judge_frame(time_s + 1e-4 * k) for k in range(250))
    assert not any(watch.judge_frame(time_s + 0.1 + PERIOD_S * k) for k in range(500))


def test_two_counters_in_turn_from_the_start_are_doubted() -> None:
    """Where the rate is not known yet, a counter that jumps in every other frame is rejected."""
    decoder = counter_decoder()
    events = []
    for k in range(400):
        time_s = 0.01 * k
        events += decoder.decode(time_s, 0xB0, False, counts_frame(*[counts_at(20.0, time_s)] * 4))
        other = 30_000 + counts_at(19.0, time_s)
        events += decoder.decode(time_s + 0.004, 0xB0, False, counts_frame(*[other] * 4))

    assert {"jump", "spoofed"} <= {fault.kind for fault in faults(events)}
    assert max(sample.time_s for sample in rotations(events)) < 0.5


def test_one_wheel_that_jumps_does_not_take_the_others_along() -> None:
    """A broken ring on one wheel: that wheel is doubted, the other three give their samples."""
    decoder = counter_decoder()
    events = []
    for k in range(400):
        time_s = 0.01 * k
        count = counts_at(20.0, time_s)
        broken = count + (20_000 if k % 2 else 0)
        events += decoder.decode(time_s, 0xB0, False, counts_frame(broken, count, count, count))

    assert [400, 400, 400] == [len(rotations(events, wheel)) for wheel in (1, 2, 3)]
    assert len(rotations(events, 0)) < 60
    assert {0} == {fault.wheel for fault in faults(events)}


def test_a_counter_that_thaws_is_followed_at_once() -> None:
    """After ten seconds of a frozen value at 28 m/s the counter is taken up within 0.3 s."""
    decoder = counter_decoder()
    for k in range(1200):
        time_s = 0.01 * k
        held = counts_at(28.0, min(time_s, 2.0))
        decoder.decode(time_s, 0xB0, False, counts_frame(*[held] * 4))
    late = []
    for k in range(1200, 1300):
        time_s = 0.01 * k
        late += decoder.decode(time_s, 0xB0, False, counts_frame(*[counts_at(28.0, time_s) + 7000] * 4))

    assert rotations(late, 2)[0].time_s < 12.3
    assert len(rotations(late, 2)) > 70
