"""The watch over a car's resonances: learning, evidence, silence with a reason, restart."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import pytest

from tests.onboard.resonance.oscillator import jitter
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.resonance.evidence import ResonanceEvidence
from tpmsd.onboard.resonance.watch import ResonanceState, ResonanceWatch
from tpmsd.onboard.sources.events import RotationSample

RADIUS_M = (0.3, 0.3, 0.3, 0.3)
RATE_HZ = 100.0
SPEED_RADPS = 50.0


def readings(seed: int, seconds: float, frequencies_hz: tuple[float, ...], std: float = 0.03) -> FloatArray:
    """(wheels, n) speeds at 15 m/s with a resonance each."""
    rng = np.random.default_rng(seed)
    return np.stack([SPEED_RADPS + jitter(rng, seconds, RATE_HZ, hz, 0.12, std) for hz in frequencies_hz])


class Takes(Protocol):
    """Whatever takes samples."""

    def add(self, sample: RotationSample) -> None:
        """Take one."""


def drive(
    watch: Takes, speeds: FloatArray, begin_s: float, rate_hz: float = RATE_HZ, quantum: float = 0.0
) -> float:
    """Hand a drive over, wheel after wheel at each instant; when it ends."""
    angles = np.cumsum(0.5 * (speeds[:, 1:] + speeds[:, :-1]), axis=1) / rate_hz
    if quantum:
        angles = np.floor(angles / quantum) * quantum
    for number, column in enumerate(angles.T.tolist()):
        for wheel, angle in enumerate(column):
            watch.add(RotationSample(begin_s + number / rate_hz, wheel, angle, quantum, 0))
    return float(begin_s + speeds.shape[1] / rate_hz + 5.0)


@pytest.fixture(scope="module")
def learned() -> dict[str, object]:
    """What a watch has learned of three sound wheels in six minutes."""
    watch = ResonanceWatch(RADIUS_M)
    drive(watch, readings(1, 360.0, (36.0, 37.0, 35.0)), 0.0)
    assert [ResonanceState.MONITORING] * 3 == [entry.state for entry in watch.status()[:3]]
    return watch.snapshot()


def resumed(saved: dict[str, object]) -> ResonanceWatch:
    """A watch after a restart."""
    watch = ResonanceWatch(RADIUS_M)
    watch.restore(saved)
    return watch


def test_the_wheel_that_lost_pressure_is_named(learned: dict[str, object]) -> None:
    """After a restart, 8 % down on the second wheel speaks for it and against the others."""
    watch = resumed(learned)
    drive(watch, readings(2, 240.0, (36.0, 37.0 * 0.92, 35.0)), 1000.0)
    status = watch.status()

    assert 37.0 * 0.92 == pytest.approx(status[1].frequency_hz, abs=4.0 * status[1].std_hz)
    assert 37.0 == pytest.approx(status[1].baseline_hz, abs=1.0)
    assert status[1].llr > 1.0
    assert max(status[0].llr, status[2].llr) < 0.0
    assert (0, 1, 2) == watch.evidence.wheels


def test_sound_wheels_stay_sound(learned: dict[str, object]) -> None:
    """On another road of the same kind no wheel is spoken against."""
    watch = resumed(learned)
    drive(watch, readings(3, 240.0, (36.0, 37.0, 35.0), std=0.05), 1000.0)

    assert max(entry.llr for entry in watch.status()[:3]) < 0.0


def test_the_same_samples_give_the_same_evidence_to_the_last_bit(learned: dict[str, object]) -> None:
    """Two watches that saw the same agree exactly."""
    first, second = resumed(learned), resumed(learned)
    speeds = readings(4, 90.0, (36.0, 35.0, 35.0))
    for watch in (first, second):
        drive(watch, speeds, 1000.0)

    assert first.status() == second.status()
    assert first.evidence == second.evidence
    assert first.snapshot() == second.snapshot()


def test_forgetting_learns_anew(learned: dict[str, object]) -> None:
    """After a reset there is neither baseline nor evidence."""
    watch = resumed(learned)
    watch.forget()

    assert ResonanceEvidence.silent() == watch.evidence
    assert all(not entry["baselines"] for entry in watch.snapshot().values())


def test_slow_sampling_is_off_with_the_reason() -> None:
    """At 50 Hz the watch is off and says so; the fourth wheel, never heard of, waits."""
    watch = ResonanceWatch(RADIUS_M)
    rng = np.random.default_rng(5)
    drive(watch, SPEED_RADPS + 0.02 * rng.normal(size=(3, 600)), 0.0, rate_hz=50.0)
    states = [entry.state for entry in watch.status()]

    assert [ResonanceState.OFF] * 3 + [ResonanceState.WAITING] == states
    assert "sampled at 50 Hz" in watch.status()[0].reason


def test_another_rate_is_believed_when_it_lasts() -> None:
    """After a first block at 50 Hz a minute at 100 Hz makes the wheel one of 100 Hz."""
    watch = ResonanceWatch(RADIUS_M)
    rng = np.random.default_rng(8)
    begin_s = drive(watch, SPEED_RADPS + 0.02 * rng.normal(size=(1, 600)), 0.0, rate_hz=50.0)
    begin_s = drive(watch, SPEED_RADPS + 0.02 * rng.normal(size=(1, 5500)), begin_s)
    assert ResonanceState.OFF == watch.status()[0].state
    drive(watch, SPEED_RADPS + 0.02 * rng.normal(size=(1, 2500)), begin_s)

    assert ResonanceState.WAITING == watch.status()[0].state


def test_a_coarse_counter_is_off_with_the_reason() -> None:
    """48 counts a turn hide the resonance; after ten minutes that is what is said."""
    watch = ResonanceWatch(RADIUS_M)
    speeds = readings(6, 640.0, (36.0,))
    wander = np.cumsum(np.random.default_rng(6).normal(size=speeds.shape), axis=1) * 0.01
    drive(watch, speeds + np.clip(wander, -4.0, 4.0), 0.0, quantum=2.0 * math.pi / 48)
    status = watch.status()[0]

    assert ResonanceState.OFF == status.state
    assert "resolution" in status.reason
    assert ResonanceEvidence.silent() == watch.evidence


def test_white_jitter_is_off_with_the_reason() -> None:
    """Where no resonance stands out there is none, however fine the signal."""
    watch = ResonanceWatch(RADIUS_M)
    noise = np.random.default_rng(7).normal(size=(1, 64_000))
    drive(watch, SPEED_RADPS + 0.03 * noise, 0.0)
    status = watch.status()[0]

    assert ResonanceState.OFF == status.state
    assert "no resonance stands out" in status.reason


@pytest.mark.parametrize(
    "spoil",
    [
        lambda saved: {},
        lambda saved: {**saved, "fl": None},
        lambda saved: {**saved, "fl": {**saved["fl"], "rate_hz": -1.0}},
        lambda saved: {**saved, "fl": {**saved["fl"], "ring_scale": 3.0}},
        lambda saved: {**saved, "fl": {**saved["fl"], "baselines": {"99": saved["fl"]["baselines"]["1"]}}},
        lambda saved: {**saved, "fl": {**saved["fl"], "baselines": {"1": {"averages": 5.0, "density": []}}}},
        lambda saved: {**saved, "fl": {**saved["fl"], "rate_hz": 20.0}},
    ],
)
def test_a_damaged_state_is_refused_whole(learned: dict[str, object], spoil: object) -> None:
    """ValueError, and the watch stays as it was."""
    watch = resumed(learned)
    before = watch.snapshot()
    assert callable(spoil)
    with pytest.raises(ValueError, match="saved"):
        watch.restore(spoil(learned))

    assert before == watch.snapshot()
