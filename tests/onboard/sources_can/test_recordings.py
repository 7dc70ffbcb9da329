"""Real drives: what comes out of them against what is known of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.onboard.sources_can.build import faults, rotations
from tpmsd.car.config.load import load_config
from tpmsd.onboard.sources.can.decoder import CanDecoder, load_database
from tpmsd.onboard.sources.can.log import CanFrame, find_can_log, read_can_log
from tpmsd.onboard.sources.events import Event, InertialSample


def decode(folder: Path) -> tuple[list[CanFrame], list[Event], CanDecoder]:
    """Frames, events and the decoder with its counts."""
    loaded = load_config(folder)
    decoder = CanDecoder(loaded, load_database(loaded.can.dbc))
    frames = list(read_can_log(find_can_log(folder)))
    events = [
        event for f in frames for event in decoder.decode(f.time_s, f.arbitration_id, f.is_extended, f.data)
    ]
    return frames, events, decoder


def test_four_wheel_speeds_of_a_car(recordings: Path) -> None:
    """A minute of a RAV4: four wheels agree within a per cent, in one segment, and 83 frames a second."""
    frames, events, decoder = decode(recordings / "rav4-suburb-60s")
    last = {sample.wheel: sample for sample in rotations(events)}
    distances_m = [last[wheel].angle_rad * 0.344 for wheel in range(4)]

    assert (53800, 53800) == (len(frames), decoder.counts["frames"])
    assert {0} == {sample.segment for sample in rotations(events)}
    assert 4974 == len(rotations(events, wheel=2))
    assert [1003.8] * 4 == pytest.approx(distances_m, rel=0.005)
    assert {"lost"} == {fault.kind for fault in faults(events)}
    # 25 frames are missing at 12 ms; its time stamps jitter by 6 ms.
    assert decoder.counts["rl.lost"] <= 25

    yaw = [e.value for e in events if isinstance(e, InertialSample) and e.role == "yaw_rate"]
    assert 4974 - 20 < len(yaw) < 4974 + 20
    assert all(abs(value) < 1.0 for value in yaw)


@pytest.mark.parametrize(("name", "jumps"), [("van-motorway-a", 0), ("van-motorway-b", 0), ("van-oval", 1)])
def test_encoder_counts_of_a_van(recordings: Path, name: str, jumps: int) -> None:
    """32-bit counts that begin at zero: the angle is the last count times one quantum, in one segment."""
    _, events, decoder = decode(recordings / name)

    assert {0} == {sample.segment for sample in rotations(events)}
    for wheel in (2, 3):
        last = rotations(events, wheel)[-1]
        assert _last_raw(recordings / name, wheel) == round(last.angle_rad / last.quantum_rad, 3)
    # The oval has one frame with values out of the blue.
    assert (jumps, jumps) == (decoder.counts["rl.jump"], decoder.counts["rr.jump"])
    assert {fault.kind for fault in faults(events)} <= {"jump", "lost"}
    assert decoder.counts["rl.lost"] <= 1


def _last_raw(folder: Path, wheel: int) -> int:
    """The counter in the last frame of the log, read without the decoder."""
    *_, frame = read_can_log(find_can_log(folder))
    return int.from_bytes(frame.data[4 * (wheel - 2) :][:4], "little")
