"""Faults of the wheels' frames: what was wrong is counted and said, and alarms are neither lost nor false."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
import pytest

from tests.faults.drives import FOUND, FROM_S, Change, Item, Outcome, drive, during, played
from tpmsd.car.config.model import Config
from tpmsd.onboard.sources.can.frame import CanFrame

pytestmark = pytest.mark.usefixtures("method")

Frames = Callable[[CanFrame], Iterable[CanFrame]]
SPEED_OFFSET = 6767
"""Raw value of 0 km/h on the simulator's bus `speeds`; its last signal is the rear left wheel."""


def frames(replace: Frames, to_s: float = 90.0) -> Change:
    """Put other frames into the place of each of the wheels' frames while something happens."""

    def change(items: list[Item], start_s: float) -> list[Item]:
        out: list[Item] = []
        for item in items:
            wheels = isinstance(item, CanFrame) and item.arbitration_id in (0xB0, 0xAA)
            if wheels and during(item.time_s, start_s, FROM_S, to_s):
                out += replace(item)
            else:
                out.append(item)
        return sorted(out, key=lambda item: item.time_s)

    return change


def frozen() -> Frames:
    """The first frame's data again and again."""
    held: list[bytes] = []

    def replace(frame: CanFrame) -> list[CanFrame]:
        held.append(frame.data)
        return [frame._replace(data=held[0])]

    return replace


def spoofed_counts(per_frame: int) -> Frames:
    """Another node's counters beside the true ones, on which the rear left wheel turns 2 % faster."""
    own = np.array([100.0, 7000.0, 30000.0, 50000.0])
    last: list[np.ndarray] = []

    def replace(frame: CanFrame) -> list[CanFrame]:
        counts = np.frombuffer(frame.data, "<u2").astype(np.int64)
        last.append(counts)
        out = [frame]
        for number in range(per_frame):
            own[:] += (counts - last[-2 if len(last) > 1 else -1]) % 65536 / per_frame * [1, 1, 1.02, 1]
            data = (own.astype(np.int64) % 65536).astype("<u2").tobytes()
            out.append(frame._replace(time_s=frame.time_s + 0.02 * (number + 0.5) / per_frame, data=data))
        return out

    return replace


def spoofed_speeds(per_frame: int) -> Frames:
    """Copies of each frame with a rear left wheel that turns 2 % faster."""

    def replace(frame: CanFrame) -> list[CanFrame]:
        raw = np.frombuffer(frame.data, ">u2").astype(np.int64)
        raw[3] = round((raw[3] - SPEED_OFFSET) * 1.02) + SPEED_OFFSET
        data = raw.astype(">u2").tobytes()
        later = (frame.time_s + 0.01 * (k + 0.5) / per_frame for k in range(per_frame))
        return [frame, *(frame._replace(time_s=time_s, data=data) for time_s in later)]

    return replace


def impatient(config: Config) -> Config:
    """Malfunctions after 8 s instead of 30."""
    return dataclasses.replace(config, monitor=dataclasses.replace(config.monitor, malfunction_s=8.0))


def tyre_alarms(outcome: Outcome) -> list[tuple[str, str | None, str]]:
    return [alarm for alarm in outcome.alarms if alarm[0] != "malfunction"]


def test_without_a_fault_the_loss_is_found() -> None:
    """The drive of these tests: the loss is announced once, on its wheel, and nothing else is."""
    outcome = played()

    assert FOUND == outcome.alarms
    assert 105.0 < outcome.when("deflation") < 125.0
    assert {"lost"} >= {kind for _, kind in outcome.faults}


def test_a_silent_wheel_message_is_a_malfunction_that_ends() -> None:
    """Wheels lost for 25 s: time-outs counted, a malfunction said and taken back, the loss found later."""
    outcome = played(frames(lambda frame: []), config=impatient)

    assert ("malfunction", None, "raised") == outcome.alarms[0]
    assert "no usable signal of the rear wheels" == outcome.reasons[0]
    assert ("malfunction", None, "cleared") in outcome.alarms
    assert FOUND == tyre_alarms(outcome)
    assert outcome.counts["timeout"] >= 4
    assert 24.0 < outcome.blind() < 26.0


def test_every_fifth_frame_lost_costs_nothing() -> None:
    """Lost frames are counted one by one; no tick is without its rotation."""
    numbers = iter(range(10_000))
    outcome = played(frames(lambda frame: [] if next(numbers) % 5 == 0 else [frame]))

    assert FOUND == outcome.alarms
    assert outcome.counts["lost"] >= 4 * 248
    assert outcome.blind() < 0.5


def test_frozen_counters_are_no_standstill() -> None:
    """Counters that freeze at 28 m/s are withheld, then told by the receiver, and followed again after."""
    outcome = played(frames(frozen()), config=impatient)

    assert ("malfunction", None, "raised") == outcome.alarms[0]
    assert outcome.reasons[0].startswith("wheels and receiver disagree on the speed")
    assert ("malfunction", None, "cleared") in outcome.alarms
    assert FOUND == tyre_alarms(outcome)
    assert outcome.counts["repeated"] > 4 * 100


def test_counters_frozen_for_two_seconds_are_left_out() -> None:
    """For less than three seconds nothing is made of the standing counters: no car stops so hard."""
    outcome = played(frames(frozen(), FROM_S + 2.0))

    assert FOUND == outcome.alarms
    assert 1.8 < outcome.blind() < 3.0
    assert 0 == sum(
        bool(np.all(s.tick.rotation_rad == 0.0))
        for s in outcome.steps
        if s.tick.time_s > outcome.start_s + 40
    )


def test_frozen_speeds_are_stuck() -> None:
    """Four speeds that stay the same to the last bit at 28 m/s: stuck within two seconds, and no readings."""
    outcome = played(frames(frozen()), "speeds", config=impatient)

    assert ("malfunction", None, "raised") == outcome.alarms[0]
    assert "no usable signal of the rear wheels" == outcome.reasons[0]
    assert ("malfunction", None, "cleared") in outcome.alarms
    assert FOUND == tyre_alarms(outcome)
    assert 4 == outcome.counts["stuck"]
    assert outcome.blind() > 23.0


def test_frames_sent_twice_are_used_once() -> None:
    """A frame with its very stamp and data again is counted and left out."""
    outcome = played(frames(lambda frame: [frame, frame]))

    assert FOUND == outcome.alarms
    assert 5000 == outcome.counts["repeated"]
    assert outcome.blind() < 0.5


def test_frames_out_of_order_are_late() -> None:
    """Every other pair of frames swapped: the later ones count as late, and the angle goes on."""

    def swapped(items: list[Item], start_s: float) -> list[Item]:
        out = list(items)
        for index in range(0, len(out) - 1, 3):
            if during(out[index].time_s, start_s) and during(out[index + 1].time_s, start_s):
                out[index], out[index + 1] = out[index + 1], out[index]
        return out

    outcome = played(swapped)

    assert FOUND == outcome.alarms
    assert outcome.counts["late"] > 500
    assert outcome.blind() < 0.5


def test_jumps_are_reported_and_left_out() -> None:
    """A counter leap every second, and odd values between: counted, and no radius moves by them."""
    rng = np.random.default_rng(5)
    offset = [np.zeros(4, dtype=np.int64)]

    def replace(frame: CanFrame) -> list[CanFrame]:
        counts = np.frombuffer(frame.data, "<u2").astype(np.int64)
        if rng.random() < 0.02:
            offset[0] = rng.integers(0, 65536, 4)
        seen = counts + offset[0]
        if rng.random() < 0.02:
            seen = rng.integers(0, 65536, 4)
        return [frame._replace(data=(seen % 65536).astype("<u2").tobytes())]

    outcome = played(frames(replace))

    assert FOUND == outcome.alarms
    assert outcome.counts["jump"] + outcome.counts["reset"] > 100


@pytest.mark.parametrize("kind", ["counts16", "speeds"])
def test_a_pattern_that_says_no_value_is_none(kind: str) -> None:
    """All ones for 25 s, which the DBC does not call invalid: no speed comes of it, and the loss is found."""
    outcome = played(frames(lambda frame: [frame._replace(data=b"\xff" * 8)]), kind, config=impatient)

    assert ("malfunction", None, "raised") == outcome.alarms[0]
    assert ("malfunction", None, "cleared") in outcome.alarms
    assert FOUND == tyre_alarms(outcome)
    assert outcome.counts["jump"] > 0


@pytest.mark.parametrize(
    ("kind", "others"),
    [
        ("counts16", spoofed_counts(1)),
        ("counts16", spoofed_counts(3)),
        ("speeds", spoofed_speeds(1)),
        ("speeds", spoofed_speeds(3)),
    ],
)
def test_a_spoofing_node_is_reported_and_not_believed(kind: str, others: Frames) -> None:
    """A node that adds frames with a soft rear left tyre: found within a second, a malfunction, no alarm."""
    outcome = played(frames(others), kind, config=impatient)

    assert ("malfunction", None, "raised") == outcome.alarms[0]
    assert "another node sends the wheels' frames: they are rejected" in outcome.reasons
    assert {("malfunction", None, "raised"), ("malfunction", None, "cleared")} == {
        alarm for alarm in outcome.alarms if alarm[0] == "malfunction"
    }
    assert FOUND == tyre_alarms(outcome)
    assert outcome.counts["spoofed"] > 4 * 1000
    assert outcome.blind() > 24.0
    first_s = next(
        step.tick.time_s - outcome.start_s
        for step in outcome.steps
        if any(fault.kind == "spoofed" for fault in step.tick.faults)
    )
    assert first_s < FROM_S + 1.5


def test_a_sender_that_becomes_faster_is_believed_in_the_end() -> None:
    """Twice the frames with values as even as before: withheld for ten seconds, then taken as they are."""
    last: list[np.ndarray] = []

    def replace(frame: CanFrame) -> list[CanFrame]:
        counts = np.frombuffer(frame.data, "<u2").astype(np.int64)
        last.append(counts)
        before = last[-2] if len(last) > 1 else counts
        between = (before + ((counts - before) % 65536) // 2) % 65536
        return [frame._replace(time_s=frame.time_s - 0.01, data=between.astype("<u2").tobytes()), frame]

    outcome = played(frames(replace, 150.0))

    assert FOUND == outcome.alarms
    assert 9.0 < outcome.blind() < 13.0


def test_a_flood_of_other_frames_changes_nothing() -> None:
    """Ten thousand frames of other identifiers, and of this one with the wrong length: ignored or short."""
    noise = [CanFrame(0.0, "can0", 0x123 + k, False, False, False, False, bytes(8)) for k in range(8)]

    def replace(frame: CanFrame) -> list[CanFrame]:
        others = [other._replace(time_s=frame.time_s) for other in noise]
        return [frame, *others]

    outcome = played(frames(replace))

    assert FOUND == outcome.alarms
    assert 8 * 1250 == outcome.counts["ignored"]


def test_the_dbc_of_another_car_is_a_malfunction() -> None:
    """A ring of other teeth: wheels and receiver disagree, which is said; no tyre is accused."""

    def wrong(config: Config) -> Config:
        vehicle = dataclasses.replace(config.vehicle, teeth_per_rev=96.0)
        return dataclasses.replace(impatient(config), vehicle=vehicle)

    outcome = played(lambda items, start_s: items[: len(items) // 2], config=wrong)

    assert [("malfunction", None, "raised")] == outcome.alarms
    assert outcome.reasons[0].startswith("wheels and receiver disagree on the speed")


def test_a_dbc_with_other_identifiers_is_a_malfunction() -> None:
    """None of the frames is the one that the DBC names: time-outs, and a malfunction of the wheels."""

    def moved(items: list[Item], start_s: float) -> list[Item]:
        half = items[: len(items) // 3]
        return [i._replace(arbitration_id=0x555) if isinstance(i, CanFrame) else i for i in half]

    outcome = played(moved, config=impatient)

    assert [("malfunction", None, "raised")] == outcome.alarms
    assert ["no usable signal of the rear wheels"] == outcome.reasons
    assert outcome.counts["timeout"] > 0


def test_a_dbc_that_reads_other_bits_raises_no_tyre_alarm() -> None:
    """Wheels read half a byte off make no sense: whatever is said, it is not that a tyre is soft."""

    def shifted(items: list[Item], start_s: float) -> list[Item]:
        out: list[Item] = []
        for item in items[: 2 * len(items) // 3]:
            if isinstance(item, CanFrame) and item.arbitration_id == 0xB0:
                word = int.from_bytes(item.data, "little")
                item = item._replace(data=((word << 4 | word >> 60) & (1 << 64) - 1).to_bytes(8, "little"))
            out.append(item)
        return out

    outcome = played(shifted, config=impatient)

    assert [] == tyre_alarms(outcome)
    assert ("malfunction", None, "raised") in outcome.alarms


def test_the_drives_hold_what_the_tests_take_for_granted() -> None:
    """The frames that the tests replace are there, at 50 and 83 Hz, with all four wheels in each."""
    for kind, number, rate_hz in (("counts16", 0xB0, 50), ("speeds", 0xAA, 83)):
        _, items = drive(kind)
        found = [i for i in items if isinstance(i, CanFrame) and i.arbitration_id == number]
        assert rate_hz == pytest.approx(len(found) / 150.0, rel=0.02)
        assert {8} == {len(frame.data) for frame in found}
