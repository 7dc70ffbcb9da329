"""Rotation samples become blocks of even speed."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from tpmsd.onboard.resonance.wheel_stream import SpeedBlock, WheelStream
from tpmsd.onboard.sources.can.faults import FaultLog
from tpmsd.onboard.sources.events import Event, RotationSample
from tpmsd.onboard.sources.wheel_speed import WheelSpeedIntegrator


def blocks(stream: WheelStream, samples: list[RotationSample]) -> list[SpeedBlock]:
    """All blocks that these samples complete."""
    return [block for sample in samples if (block := stream.add(sample)) is not None]


def counted(rate_hz: float, seconds: float, speed_radps: float, begin_s: float = 0.0) -> list[RotationSample]:
    """A counter of 4096 per revolution on a wheel at constant speed."""
    quantum = 2.0 * math.pi / 4096
    at = np.arange(round(seconds * rate_hz)) / rate_hz
    return [
        RotationSample(begin_s + t, 0, math.floor(speed_radps * t / quantum) * quantum, quantum, 0)
        for t in at.tolist()
    ]


def test_readings_of_a_speed_signal_come_back() -> None:
    """Of the decoder's integral every reading is found again, though stamps jitter by half a period."""
    rng = np.random.default_rng(1)
    readings = 50.0 + np.round(rng.normal(size=1200) / 0.01) * 0.01
    stamps = np.arange(1200) * 0.01 + rng.uniform(-0.0045, 0.0045, size=1200)
    integrator, events = WheelSpeedIntegrator(0, 0.3, FaultLog()), list[Event]()
    for stamp, reading in zip(stamps.tolist(), readings.tolist(), strict=True):
        integrator.update(stamp, reading, 0.01, events)
    (block,) = blocks(WheelStream(), [event for event in events if isinstance(event, RotationSample)])

    assert np.abs(block.speed_radps - readings[1 : block.speed_radps.size + 1]).max() < 0.1
    assert (
        np.std(block.speed_radps - readings[1 : block.speed_radps.size + 1] - _alternating(block, readings))
        < 1e-6
    )
    assert 0.01 == pytest.approx(block.quantum_radps, abs=1e-5)
    assert not block.counted


def _alternating(block: SpeedBlock, readings: np.ndarray) -> np.ndarray:
    """The one part that an integral does not tell: a constant of alternating sign."""
    rest = block.speed_radps - readings[1 : block.speed_radps.size + 1]
    sign = np.where(np.arange(rest.size) % 2 == 0, 1.0, -1.0)
    return np.asarray(sign * np.mean(sign * rest))


def test_a_counter_gives_its_mean_speeds() -> None:
    """Differences of counts over the mean period; the resolution is a count per period."""
    (block,) = blocks(WheelStream(), counted(100.0, 10.4, 60.0))

    assert block.counted
    assert 100.0 == pytest.approx(block.rate_hz)
    assert 60.0 == pytest.approx(block.speed_radps.mean(), rel=1e-4)
    assert 2.0 * math.pi / 4096 * 100.0 == pytest.approx(block.quantum_radps)
    assert np.sinc(0.4) ** 2 == pytest.approx(block.power_response(np.array([40.0]))[0])


def test_a_gap_begins_the_block_anew() -> None:
    """Lost frames are not bridged: the block counts from behind the gap."""
    early = counted(100.0, 6.0, 60.0)
    late = counted(100.0, 10.5, 60.0, begin_s=6.2)

    assert [] == blocks(WheelStream(), early + late[:1000])
    assert 1 == len(blocks(WheelStream(), early + late))


def test_another_segment_begins_the_block_anew() -> None:
    """Angles of two segments are never subtracted."""
    early = counted(100.0, 6.0, 60.0)
    late = [sample._replace(segment=1) for sample in counted(100.0, 9.0, 60.0, begin_s=6.0)]

    assert [] == blocks(WheelStream(), early + late)


def test_braking_is_no_steady_rolling() -> None:
    """A block in which the speed halves is left out."""
    quantum = 2.0 * math.pi / 4096
    at = np.arange(1100) / 100.0
    angle = 60.0 * at - 0.5 * 3.5 * at**2
    samples = [
        RotationSample(t, 0, math.floor(a / quantum) * quantum, quantum, 0)
        for t, a in zip(at.tolist(), angle.tolist(), strict=True)
    ]

    assert [] == blocks(WheelStream(), samples)


def test_a_standing_wheel_gives_no_block() -> None:
    """Nothing is made of a wheel that does not turn."""
    still = [RotationSample(number / 100.0, 0, 0.0, 0.1, 0) for number in range(1100)]

    assert Counter() == Counter(block.counted for block in blocks(WheelStream(), still))


def test_samples_in_runs_make_the_same_blocks() -> None:
    """Runs of five samples, refused ones added singly, complete the very blocks of samples one by one: over a
    gap, a new segment, stamps that stand still and another quantum."""
    samples = counted(50.0, 35.0, 60.0)
    later = counted(50.0, 30.0, 61.0, begin_s=40.0)
    samples += [RotationSample(s.time_s, 0, s.angle_rad, s.quantum_rad, 1) for s in later]
    samples[300] = RotationSample(samples[299].time_s, 0, samples[300].angle_rad, samples[300].quantum_rad, 0)
    expected = blocks(WheelStream(), samples)

    stream, found, taken = WheelStream(), list[SpeedBlock](), 0
    for at in range(0, len(samples), 5):
        run = samples[at : at + 5]
        columns = [s.time_s for s in run], [s.angle_rad for s in run]
        similar = all(s.segment == run[0].segment for s in run)
        if similar and stream.extend(*columns, run[0].segment, run[0].quantum_rad):
            taken += 1
        else:
            found += blocks(stream, run)
    assert taken > 0.7 * len(samples) / 5
    assert [block.rate_hz for block in expected] == [block.rate_hz for block in found]
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one.speed_radps, other.speed_radps)
