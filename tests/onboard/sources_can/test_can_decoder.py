"""The decoder as a whole: wheels together, time-outs, clocks, short and invalid frames, and exact counts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.onboard.sources_can.build import (
    COUNTERS_DBC,
    RADIUS_M,
    TEETH,
    config,
    counter_decoder,
    counts_at,
    counts_frame,
    database,
    faults,
    four,
    rotations,
    speed_decoder,
    speeds_frame,
)
from tpmsd.onboard.sources.can.decoder import CanDecoder
from tpmsd.onboard.sources.events import Event, InertialSample, SourceFault


def drive(
    decoder: CanDecoder,
    start_s: float,
    end_s: float,
    speed_mps: float = 20.0,
    frozen: dict[int, int] | None = None,
) -> list[Event]:
    """Events of 100 frames a second at a constant speed; `frozen` wheels keep their count."""
    out: list[Event] = []
    for step in range(round(start_s * 100), round(end_s * 100)):
        time_s = step / 100
        counts = [counts_at(speed_mps, time_s)] * 4
        for wheel, count in (frozen or {}).items():
            counts[wheel] = count
        out += decoder.decode(time_s, 0xB0, False, counts_frame(*counts))
    return out


def test_the_angle_of_a_counter_is_eq_37() -> None:
    """Angle = counts * 2 pi / teeth per revolution, for each wheel from its own bits."""
    decoder = counter_decoder()
    decoder.decode(0.0, 0xB0, False, counts_frame(10, 20, 65530, 40))
    samples = rotations(decoder.decode(0.01, 0xB0, False, counts_frame(11, 22, 65533, 44)))

    assert [0, 1, 2, 3] == [sample.wheel for sample in samples]
    expected = [count * 2 * math.pi / TEETH for count in (1, 2, 3, 4)]
    assert expected == pytest.approx([sample.angle_rad for sample in samples], rel=1e-12)
    assert {2 * math.pi / TEETH} == {sample.quantum_rad for sample in samples}


def test_a_stuck_counter_is_distinguished_from_a_standing_car() -> None:
    """A wheel whose count stands while the others turn is stuck after half a second, and gives no sample."""
    decoder = counter_decoder()
    drive(decoder, 0.0, 2.0)
    frozen = counts_at(20.0, 1.99)
    events = drive(decoder, 2.0, 4.0, frozen={2: frozen})

    assert [] == rotations(events, wheel=2)
    assert ["stuck"] == [fault.kind for fault in faults(events) if fault.kind != "repeated"]
    assert 2.5 == pytest.approx(
        next(fault.time_s for fault in faults(events) if fault.kind == "stuck"), abs=0.02
    )
    assert 1 == decoder.counts["rl.stuck"]
    assert 200 == len(rotations(events, wheel=3))

    after = rotations(drive(decoder, 4.0, 5.0), wheel=2)
    assert {1} == {sample.segment for sample in after}
    distance = (counts_at(20.0, 4.99) - counts_at(20.0, 4.0)) * 2 * math.pi / TEETH
    assert distance == pytest.approx(after[-1].angle_rad, rel=1e-12)


def test_a_wheel_stuck_from_slow_driving_gives_no_distance() -> None:
    """At a count per frame the loss shows late, but the angle never differs by more than a few counts."""
    decoder = counter_decoder()
    drive(decoder, 0.0, 2.0, speed_mps=5.0)
    events = drive(decoder, 2.0, 4.0, speed_mps=5.0, frozen={2: counts_at(5.0, 1.99)})
    samples = rotations(events, wheel=2)

    assert 1 == decoder.counts["rl.stuck"]
    latest_s = max((sample.time_s for sample in samples), default=2.0)
    assert counts_at(5.0, latest_s) - counts_at(5.0, 1.99) <= 5


def test_one_spinning_wheel_does_not_make_the_others_stuck() -> None:
    """On ice one wheel turns and three stand: the three are right."""
    decoder = counter_decoder()
    drive(decoder, 0.0, 1.0, speed_mps=0.0)
    events = drive(decoder, 1.0, 4.0, frozen={1: 0, 2: 0, 3: 0})

    assert not [key for key in decoder.counts if key.endswith("stuck")]
    assert 300 == len(rotations(events, wheel=2))


def test_standstill_is_no_fault() -> None:
    """A car that brakes, stands for ten seconds and drives off keeps its segments, and nothing is counted."""
    decoder = counter_decoder()
    out: list[Event] = []
    for step in range(2000):
        time_s = step / 100
        if time_s < 2:
            distance_m = 16 * time_s - 4 * time_s**2
        else:
            distance_m = 16 + (1.5 * (time_s - 12) ** 2 if time_s > 12 else 0.0)
        count = math.floor(distance_m / (2 * math.pi * RADIUS_M) * TEETH)
        out += decoder.decode(time_s, 0xB0, False, counts_frame(*[count] * 4))

    assert {0} == {sample.segment for sample in rotations(out)}
    assert 8000 == len(rotations(out))
    assert {"frames": 2000} == dict(decoder.counts)


def test_lost_frames_are_counted_exactly() -> None:
    """Three gaps of one, two and five frames are eight lost frames of each wheel; the angle goes on."""
    decoder = counter_decoder()
    out: list[Event] = []
    missing = {100, 150, 151, 200, 201, 202, 203, 204}
    for step in range(300):
        if step not in missing:
            out += decoder.decode(step / 100, 0xB0, False, counts_frame(*[counts_at(20.0, step / 100)] * 4))

    assert [8, 8, 8, 8] == [decoder.counts[f"{wheel}.lost"] for wheel in ("fl", "fr", "rl", "rr")]
    last = rotations(out, wheel=0)[-1]
    assert (0, counts_at(20.0, 2.99)) == (last.segment, round(last.angle_rad * TEETH / (2 * math.pi)))


def test_a_frame_twice_and_a_late_frame_are_distinguished() -> None:
    """Same stamp and data: repeated; a stamp before the last one: late. Neither is used."""
    decoder = counter_decoder()
    drive(decoder, 0.0, 1.0)
    frame = counts_frame(*[counts_at(20.0, 0.99)] * 4)

    assert [] == rotations(decoder.decode(0.99, 0xB0, False, frame))
    assert [] == rotations(decoder.decode(0.98, 0xB0, False, frame))
    assert [] == rotations(decoder.decode(0.99, 0xB0, False, counts_frame(1, 2, 3, 4)))
    assert (1, 2) == (decoder.counts["rl.repeated"], decoder.counts["rl.late"])


def test_a_clock_set_back_begins_new_segments() -> None:
    """Frames behind the last stamp for a second, in order, show a stepped clock and are not late."""
    decoder = counter_decoder()
    drive(decoder, 100.0, 102.0)
    late = drive(decoder, 40.0, 40.99)
    again = rotations(drive(decoder, 40.99, 42.0), wheel=0)

    assert [] == rotations(late)
    assert {1} == {sample.segment for sample in again}
    assert 41.0 == pytest.approx(again[0].time_s, abs=0.02)
    assert 1 == decoder.counts["fl.clock_step"]
    distance = (counts_at(20.0, 41.99) - counts_at(20.0, again[0].time_s)) * 2 * math.pi / TEETH
    assert distance == pytest.approx(again[-1].angle_rad, rel=1e-12)


def test_a_single_stamp_in_the_future_costs_a_second_at_most() -> None:
    """One corrupted time stamp far ahead does not silence the wheel for good."""
    decoder = counter_decoder()
    drive(decoder, 0.0, 1.0)
    decoder.decode(5000.0, 0xB0, False, counts_frame(*[counts_at(20.0, 1.0)] * 4))
    events = rotations(drive(decoder, 1.01, 4.0), wheel=0)

    assert 195 <= len(events)
    assert 2.05 > events[0].time_s


def test_each_message_times_out_once_per_episode() -> None:
    """Ten periods without a frame (0.2 s at least) are one time-out of each of the message's signals."""
    decoder = speed_decoder(yaw_rate="MOTION.YAW")
    for step in range(100):
        decoder.decode(step / 100, 0xB0, False, speeds_frame(72, 72, 72, 72))
        if step % 10 == 0:
            decoder.decode(step / 100, 36, False, bytes(2))
    assert [] == decoder.poll(1.0)
    assert [] == decoder.poll(1.19)

    expected = [SourceFault(1.2, "can", "timeout", "WHEELS silent for 0.21 s", wheel) for wheel in range(4)]
    assert expected == decoder.poll(1.2)
    assert [] == decoder.poll(1.5)
    (fault,) = decoder.poll(1.95)
    assert ("timeout", None, "MOTION silent for 1.05 s") == (fault.kind, fault.wheel, fault.detail)
    assert (1, 1) == (decoder.counts["rr.timeout"], decoder.counts["yaw_rate.timeout"])

    back = decoder.decode(3.0, 0xB0, False, speeds_frame(72, 72, 72, 72))
    assert [] == faults(back)
    assert [1, 1, 1, 1] == [sample.segment for sample in rotations(back)]
    assert 4 == len(faults(decoder.poll(3.3)))


def test_a_message_that_is_back_with_a_late_stamp_times_out_as_any_other() -> None:
    """When a time-out is found does not depend on polls that found nothing."""
    often, seldom = speed_decoder(), speed_decoder()
    for decoder in (often, seldom):
        for step in range(101):
            decoder.decode(step / 100, 0xB0, False, speeds_frame(72, 72, 72, 72))
        assert 4 == len(decoder.poll(1.5))
    assert [] == often.poll(2.0)
    for decoder in (often, seldom):
        assert [] == faults(decoder.decode(1.85, 0xB0, False, speeds_frame(72, 72, 72, 72)))

    for decoder in (often, seldom):
        decoder.poll(2.08)
    assert (2, 2) == (often.counts["fl.timeout"], seldom.counts["fl.timeout"])


def test_a_silence_that_nobody_polled_is_a_time_out_too() -> None:
    """The next frame shows it; so a replay counts what a live run counts."""
    decoder = counter_decoder()
    drive(decoder, 0.0, 1.0)
    events = drive(decoder, 2.0, 2.01)

    assert ["timeout"] * 4 == [fault.kind for fault in faults(events)]
    # 16 bits leave no doubt about the counts in between: the segment goes on.
    last = rotations(events, wheel=0)[-1]
    assert (0, counts_at(20.0, 2.0)) == (last.segment, round(last.angle_rad * TEETH / (2 * math.pi)))


def test_a_message_that_never_comes_times_out() -> None:
    """Waiting begins with the first poll."""
    decoder = counter_decoder()
    assert [] == decoder.poll(10.0)
    assert [] == decoder.poll(11.9)

    assert "WHEELS never seen" == decoder.poll(12.1)[0].detail  # type: ignore[union-attr]
    assert [] == decoder.poll(13.0)


def test_short_frames_are_used_as_far_as_they_go() -> None:
    """Signals that are not wholly in a frame are faults; the others are read."""
    decoder = counter_decoder()
    events = decoder.decode(1.0, 0xB0, False, bytes(5))

    assert [0, 1] == [sample.wheel for sample in rotations(events)]
    assert [("short", 2), ("short", 3)] == [(fault.kind, fault.wheel) for fault in faults(events)]
    assert (2, 1) == (decoder.counts["decode.short"], decoder.counts["rl.short"])


def test_big_endian_signals_of_a_short_frame_keep_their_place() -> None:
    """A frame cut after two of four big-endian speeds still holds those two."""
    decoder = speed_decoder()
    decoder.decode(0.0, 0xB0, False, speeds_frame(36, 36))
    events = decoder.decode(0.1, 0xB0, False, speeds_frame(36, 36))

    angles = [sample.angle_rad for sample in rotations(events)]
    assert [0.1 * 10.0 / RADIUS_M] * 2 == pytest.approx(angles)


def test_longer_frames_decode_equally() -> None:
    """CAN FD pads frames; what is beyond the message's own bytes changes nothing."""
    data = counts_frame(1, 2, 3, 4)

    padded = counter_decoder().decode(1.0, 0xB0, False, data + bytes(range(40)))

    assert counter_decoder().decode(1.0, 0xB0, False, data) == padded


def test_invalid_values_are_no_readings() -> None:
    """A reserved value of a wheel speed is a fault of that wheel alone."""
    decoder = speed_decoder()
    decoder.decode(0.0, 0xB0, False, speeds_frame(36, 36, 36, 36))
    events = decoder.decode(0.1, 0xB0, False, speeds_frame(36, 36) + b"\xff\xff" + speeds_frame(36))

    assert [0, 1, 3] == [sample.wheel for sample in rotations(events)]
    assert [("invalid", 2, "WHEELS.RL = 0xffff")] == [(f.kind, f.wheel, f.detail) for f in faults(events)]


def test_a_number_that_is_none_is_invalid() -> None:
    """IEEE NaN and infinity are no readings either."""
    text = """VERSION ""
BO_ 1 M: 8 CAR
 SG_ YAW : 0|32@1- (1,0) [0|0] "rad/s" CAR
SIG_VALTYPE_ 1 YAW : 1;
"""
    decoder = CanDecoder(config({"yaw_rate": "M.YAW"}), database(text))

    assert ["invalid"] == [f.kind for f in faults(decoder.decode(0.0, 1, False, b"\x00\x00\xc0\x7f"))]
    assert [] == decoder.decode(0.1, 1, False, b"\x00\x00\x80\x7f")  # counted, but not reported so soon again
    assert [InertialSample(0.2, "yaw_rate", 0.5)] == decoder.decode(0.2, 1, False, b"\x00\x00\x00\x3f")
    assert 2 == decoder.counts["yaw_rate.invalid"]


def test_reports_are_limited_and_counts_are_not() -> None:
    """A fault in every frame is reported at once and then once a second, but counted every time."""
    decoder = counter_decoder()
    reported: list[float] = []
    for step in range(350):
        events = decoder.decode(step / 100, 0xB0, False, bytes(6))
        reported += [fault.time_s for fault in faults(events)]

    assert [0.0, 1.0, 2.0, 3.0] == reported
    assert 350 == decoder.counts["rr.short"]


def test_counters_win_over_speeds_of_the_same_wheel() -> None:
    """With both configured a wheel has one angle, from its counter."""
    text = COUNTERS_DBC + 'BO_ 200 V: 8 CAR\n SG_ FL : 0|16@1+ (0.01,0) [0|300] "km/h" CAR\n'
    decoder = CanDecoder(config(four("count") | {"wheel_speed_fl": "V.FL"}), database(text))

    assert [] == decoder.decode(0.0, 200, False, bytes(8))
    assert 1 == decoder.counts["ignored"]


def test_wheels_in_messages_of_their_own() -> None:
    """Wheels with different messages, periods and phases each get their own exact angle."""
    text = """VERSION ""
BO_ 1 FRONT: 8 CAR
 SG_ L : 7|10@0+ (1,0) [0|0] "" CAR
 SG_ R : 23|10@0+ (1,0) [0|0] "" CAR
BO_ 2147483650 REAR: 8 CAR
 SG_ L : 0|8@1+ (0.5,0) [0|0] "" CAR
 SG_ R : 8|8@1+ (0.5,0) [0|0] "" CAR
"""
    signals = {
        "wheel_count_fl": "FRONT.L",
        "wheel_count_fr": "FRONT.R",
        "wheel_count_rl": "REAR.L",
        "wheel_count_rr": "REAR.R",
    }
    decoder = CanDecoder(config(signals), database(text))
    out: list[Event] = []
    for step in range(1, 5000):
        time_s = step / 1000
        if step % 20 == 3:
            count = counts_at(30.0, time_s) % 1024
            word = (count << 6).to_bytes(2, "big")
            out += decoder.decode(time_s, 1, False, word + word + bytes(4))
        if step % 10 == 0:
            bits = counts_at(60.0, time_s) % 256  # half counts
            out += decoder.decode(time_s, 2, True, bytes([bits, bits]))

    front, rear = rotations(out, wheel=1), rotations(out, wheel=3)
    expected = counts_at(30.0, front[-1].time_s) - counts_at(30.0, 0.003)
    assert expected == round(front[-1].angle_rad * TEETH / (2 * math.pi), 6)
    expected = counts_at(60.0, rear[-1].time_s) - counts_at(60.0, 0.01)
    assert expected == round(rear[-1].angle_rad * TEETH / math.pi, 6)
    assert {0} == {sample.segment for sample in rotations(out)}


def test_wheels_rest_once_all_stand_and_none_has_turned_alone() -> None:
    """A car at a standstill rests after half a second; not if one wheel was turned after the others stood."""
    for turned, expected in ((0, True), (6, False)):
        decoder = counter_decoder()
        for k in range(200):
            own = 500 + min(max(k - 20, 0), turned)
            assert not decoder.all_at_rest or k > 25
            decoder.decode(10.0 + 0.02 * k, 176, False, counts_frame(own, 700, 800, 900))
        assert expected == decoder.all_at_rest


@pytest.mark.parametrize(("bunch", "inner_s"), [(3, 2e-5), (5, 2e-4), (8, 1e-3), (5, 1e-6)])
def test_frames_in_bunches_of_one_sender_have_no_faults(bunch: int, inner_s: float) -> None:
    """An adapter that hands frames over in bunches loses none, makes no reading jump and is one sender."""
    decoder = counter_decoder()
    for step in range(6000):
        place = step % bunch
        stamp_s = (step - place + bunch) / 100 + inner_s * place
        decoder.decode(stamp_s, 0xB0, False, counts_frame(*[counts_at(20.0, step / 100)] * 4))
    counts = {kind: count for kind, count in decoder.counts.items() if kind.startswith("fl.")}
    assert {"fl.lost", "fl.jump"} >= counts.keys()
    assert sum(counts.values()) <= 20, "of the first frames, before the period is known"


def test_frames_that_jitter_are_not_many_lost_ones() -> None:
    """Stamps in order that jitter by a whole period pass for fewer lost frames than a fifth."""
    decoder = counter_decoder()
    rng = np.random.default_rng(5)
    stamps = np.sort(np.arange(20000) / 100 + rng.normal(0.0, 0.01, 20000)) + 1.0
    for step, stamp_s in enumerate(stamps.tolist()):
        decoder.decode(stamp_s, 0xB0, False, counts_frame(*[counts_at(20.0, step / 100)] * 4))
    assert decoder.counts["fl.lost"] < 20000 / 5
    assert 0 == decoder.counts["fl.spoofed"]


def test_a_lost_frame_is_one_fault() -> None:
    """A frame of four wheels that is lost counts at each of them, and once in all."""
    decoder = counter_decoder()
    drive(decoder, 0.0, 5.0)
    drive(decoder, 5.02, 6.0)
    assert [2] * 4 == [decoder.counts[f"{wheel}.lost"] for wheel in ("fl", "fr", "rl", "rr")]
    total = sum(count for kind, count in decoder.counts.items() if kind.endswith(".lost"))
    assert 2 == total - decoder.shared_faults["lost"]
