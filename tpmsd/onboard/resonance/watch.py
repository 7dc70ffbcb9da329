"""Follows the torsional resonances of a car's wheels: the evidence of soft tyres, or the reason for which
there is none.

In: rotation samples of all wheels. Out: `ResonanceEvidence` against a learned baseline, and a status per
wheel.

Frequency and damping depend on speed (the contact's slip is a damper that goes with 1 / v), so there are
spectra and baselines per class of speed. A baseline is learned over LEARN_S of steady driving in its class
and then frozen; after it spectra fade over MEMORY_S. Where the bus samples too slowly, too coarsely, or the
road is too smooth, no resonance is found, and the watch is off and says so.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.onboard.resonance.evidence import ResonanceEvidence, shift_log_likelihood
from tpmsd.onboard.resonance.peak_fit import Peak, PeakFit
from tpmsd.onboard.resonance.ring_errors import RingErrors
from tpmsd.onboard.resonance.spectrum import SEGMENT_S, Spectrum, bins_hz, periodograms
from tpmsd.onboard.resonance.wheel_stream import SpeedBlock, WheelStream
from tpmsd.onboard.sources.events import RotationRun, RotationSample

SPEED_CLASSES_MPS = (8.0, 12.0, 17.0, 23.0, 30.0)
"""Lower ends; below the first nothing is taken, the last is open."""
LEARN_S = 300.0
"""Steady driving in a class of speed before its baseline is frozen."""
JUDGE_S = 60.0
"""Steady driving in a class before its spectrum says anything."""
FIT_EVERY_S = 30.0
"""A fit takes 10 to 20 ms."""
MEMORY_S = 300.0
OFF_AFTER_S = 600.0
"""Without a resonance found in this time there is none to be found."""
EDGE_NAMED = 0.94
"""Share of the highest frequency that can be seen, beyond which a peak is reported as being too high."""
RATE_TOLERANCE = 0.02
IRREGULAR_BLOCKS = 6
"""Number of blocks in a row at another rate after which the signal has changed: everything is learned
again."""


MAX_PAST = 64


class ResonanceState(StrEnum):
    """State of the resonance of one wheel."""

    WAITING = "waiting"
    """Too little steady driving yet."""
    OFF = "off"
    """The signal does not carry the resonance; `reason` says why."""
    LEARNING = "learning"
    MONITORING = "monitoring"


@dataclass(frozen=True, slots=True)
class ResonanceStatus:
    """One wheel, for status and report."""

    state: ResonanceState
    reason: str
    frequency_hz: float = math.nan
    """Newest estimate, in the class of speed most driven in; NaN while unknown."""
    std_hz: float = math.nan
    baseline_hz: float = math.nan
    llr: float = 0.0
    """Log of (likelihood soft / not soft)."""

    def to_json(self) -> dict[str, Any]:
        """Return plain values for status and report; numbers that are not known are None."""
        return {
            "state": str(self.state),
            "reason": self.reason,
            "frequency_hz": _finite_or_none(self.frequency_hz),
            "std_hz": _finite_or_none(self.std_hz),
            "baseline_hz": _finite_or_none(self.baseline_hz),
            "log_ratio_soft": _finite_or_none(self.llr),
        }


@dataclass(slots=True)
class _Class:
    """One wheel in one class of speed."""

    spectrum: Spectrum
    learned: Spectrum | None = None
    """Spectrum of the sound tyre; None while it is being learned."""
    baseline: Peak | None = None
    """Resonance in `learned`."""
    now: Peak | None = None
    unjudged_s: float = math.inf
    """Driving since the last fit."""


@dataclass(slots=True)
class _Wheel:
    """One wheel."""

    stream: WheelStream = field(default_factory=WheelStream)
    ring: RingErrors = field(default_factory=RingErrors)
    rate_hz: float = math.nan
    classes: dict[int, _Class] = field(default_factory=dict)
    driven_s: float = 0.0
    irregular_blocks: int = 0
    rounding: float = 0.0
    """Density that the signal's resolution alone makes."""


class ResonanceWatch:
    """All wheels of a car."""

    def __init__(self, wheel_radius_m: tuple[float, float, float, float]) -> None:
        self._radius_m = wheel_radius_m
        self._wheels = [_Wheel() for _ in WHEELS]
        self._fits: dict[float, PeakFit] = {}
        self._evidence = ResonanceEvidence.silent()
        self._past: deque[tuple[float, ResonanceEvidence]] = deque()

    @property
    def evidence(self) -> ResonanceEvidence:
        """Evidence of the newest blocks; that of no wheel before there is a baseline."""
        return self._evidence

    def evidence_at(self, time_s: float) -> ResonanceEvidence:
        """Return the evidence as it was at an instant; calls must be in the order of time.

        A tick is made some time after its end, and by then a live run may have seen a frame more or less
        than a replay. What was known at its end is the same in both.
        """
        past = self._past
        while len(past) > 1 and past[1][0] <= time_s:
            past.popleft()
        return past[0][1] if past and past[0][0] <= time_s else ResonanceEvidence.silent()

    def add(self, sample: RotationSample) -> None:
        """Add one sample; the block that it completes updates spectra, baselines and evidence."""
        wheel = self._wheels[sample.wheel]
        block = wheel.stream.add(sample)
        if block is None:
            return
        if not math.isfinite(wheel.rate_hz):
            wheel.rate_hz = round(block.rate_hz, 1)
        if abs(block.rate_hz / wheel.rate_hz - 1.0) > RATE_TOLERANCE:
            wheel.irregular_blocks += 1
            if wheel.irregular_blocks < IRREGULAR_BLOCKS:
                return
            # What was learned is of another signal.
            wheel.classes.clear()
            wheel.rate_hz, wheel.driven_s = round(block.rate_hz, 1), 0.0
        wheel.irregular_blocks = 0
        speed_mps = float(block.speed_radps.mean()) * self._radius_m[sample.wheel]
        number = int(np.searchsorted(SPEED_CLASSES_MPS, speed_mps, side="right")) - 1
        if number >= 0 and PeakFit.max_frequency_hz(wheel.rate_hz) > 0.0:
            self._add_block(wheel, number, block)
            self._update_evidence()
            self._past.append((sample.time_s, self._evidence))
            if len(self._past) > MAX_PAST:  # nobody asks
                self._past.popleft()

    def extend(self, run: RotationRun) -> bool:
        """Add samples of one wheel if they complete no block; False if none was added
        (`WheelStream.extend`)."""
        return self._wheels[run.wheel].stream.extend(run.time_s, run.angle_rad, run.segment, run.quantum_rad)

    def forget(self) -> None:
        """Drop all spectra and baselines, which are then learned again."""
        for wheel in self._wheels:
            wheel.classes.clear()
            wheel.driven_s = 0.0
        self._evidence = ResonanceEvidence.silent()
        self._past.clear()

    def status(self) -> tuple[ResonanceStatus, ...]:
        """Return the status of each wheel, in the order of `WHEELS`."""
        return tuple(self._wheel_status(number) for number in range(len(WHEELS)))

    # -- per block -------------------------------------------------------------------------------------------

    def _fit_for_rate(self, wheel: _Wheel) -> PeakFit:
        """Return the `PeakFit` for the wheel's sampling rate, made on first use."""
        if wheel.rate_hz not in self._fits:
            self._fits[wheel.rate_hz] = PeakFit(wheel.rate_hz)
        return self._fits[wheel.rate_hz]

    def _add_block(self, wheel: _Wheel, number: int, block: SpeedBlock) -> None:
        """Add a block to the spectrum of its speed class; fit it when due, and freeze the baseline once
        learned."""
        segments = periodograms(block, wheel.ring.remove(block), wheel.rate_hz)
        duration_s = block.speed_radps.size / block.rate_hz
        wheel.driven_s += duration_s
        wheel.rounding = block.rounding_density()
        entry = wheel.classes.get(number)
        if entry is None:
            entry = wheel.classes[number] = _Class(Spectrum.empty(bins_hz(wheel.rate_hz).size))
        for other in wheel.classes.values():
            # What was seen minutes ago fades, in whichever class one has driven since.
            if other.baseline is not None:
                other.spectrum.fade(math.exp(-duration_s / MEMORY_S))
        entry.spectrum.add(segments)
        seen_s = entry.spectrum.averages * 0.5 * SEGMENT_S
        entry.unjudged_s += duration_s
        if seen_s < JUDGE_S or entry.unjudged_s < FIT_EVERY_S:
            return
        entry.unjudged_s = 0.0
        entry.now = self._fit_for_rate(wheel).fit(entry.spectrum)
        useful = entry.now.is_usable(PeakFit.max_frequency_hz(wheel.rate_hz))
        if (
            entry.baseline is None
            and seen_s >= LEARN_S
            and useful
            and not entry.spectrum.is_rounding_limited(wheel.rounding)
        ):
            entry.learned, entry.baseline, entry.now = entry.spectrum, entry.now, None
            entry.spectrum = Spectrum.empty(bins_hz(wheel.rate_hz).size)

    def _update_evidence(self) -> None:
        """Compute `evidence` from all wheels and classes that have a baseline and a newer fit."""
        shifts: dict[int, FloatArray] = {}
        for number, wheel in enumerate(self._wheels):
            logs = [
                shift_log_likelihood(
                    entry.baseline.log_likelihood, entry.now.faded_log_likelihood(entry.spectrum.averages)
                )
                for entry in wheel.classes.values()
                if entry.baseline is not None and entry.now is not None
            ]
            if logs:
                shifts[number] = np.sum(logs, axis=0)
        self._evidence = ResonanceEvidence.from_shifts(shifts)

    def _wheel_status(self, number: int) -> ResonanceStatus:
        wheel = self._wheels[number]
        received_hz = wheel.rate_hz if math.isfinite(wheel.rate_hz) else wheel.stream.rate_hz
        if not math.isfinite(received_hz):
            return ResonanceStatus(ResonanceState.WAITING, "no steady driving yet")
        highest_hz = PeakFit.max_frequency_hz(received_hz)
        if highest_hz <= 0.0:
            reason = f"sampled at {received_hz:.0f} Hz; a resonance of 25 Hz and more needs 65 Hz or faster"
            return ResonanceStatus(ResonanceState.OFF, reason)
        known = [entry for entry in wheel.classes.values() if entry.now or entry.baseline]
        if not known:
            return ResonanceStatus(ResonanceState.WAITING, "too little steady driving yet")
        entry = max(known, key=lambda one: (one.baseline is not None, one.spectrum.averages))
        newest = entry.now or entry.baseline
        assert newest is not None
        monitoring = any(other.baseline is not None for other in wheel.classes.values())
        if not monitoring and not newest.is_usable(highest_hz):
            if wheel.driven_s < OFF_AFTER_S:
                return ResonanceStatus(ResonanceState.LEARNING, "no resonance found yet")
            return ResonanceStatus(ResonanceState.OFF, self._reason_for_none(wheel, entry, highest_hz))
        mean, std = newest.moments()
        baseline = math.nan if entry.baseline is None else entry.baseline.moments()[0]
        state = ResonanceState.MONITORING if monitoring else ResonanceState.LEARNING
        reason = "" if monitoring else "learning the resonance of the sound tyre"
        return ResonanceStatus(state, reason, mean, std, baseline, self._evidence.wheel_llr(number))

    @staticmethod
    def _reason_for_none(wheel: _Wheel, entry: _Class, highest_hz: float) -> str:
        """Return the reason, for the user, for which a wheel driven long enough shows no resonance."""
        if entry.spectrum.is_rounding_limited(wheel.rounding):
            return "the signal's resolution hides it"
        newest = entry.now
        if newest is not None and newest.found and newest.moments()[0] > EDGE_NAMED * highest_hz:
            return f"the resonance lies above {highest_hz:.0f} Hz, too close to half the sampling rate"
        return f"no resonance stands out between 25 and {highest_hz:.0f} Hz"

    # -- what survives a restart -----------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Return the learned baselines of all wheels as plain numbers for the state file."""
        return {
            name: {
                "rate_hz": wheel.rate_hz if math.isfinite(wheel.rate_hz) else None,
                "ring_scale": wheel.ring.scale,
                "baselines": {
                    str(number): entry.learned.to_json()
                    for number, entry in sorted(wheel.classes.items())
                    if entry.learned is not None
                },
            }
            for name, wheel in zip(WHEELS, self._wheels, strict=True)
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Restore a snapshot; ValueError if it is none (then nothing is restored)."""
        try:
            wheels = [self._restore_wheel(saved[name]) for name in WHEELS]
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"the saved resonances are none: {type(error).__name__}: {error}") from error
        self._wheels = wheels
        self._evidence = ResonanceEvidence.silent()
        self._past.clear()

    @staticmethod
    def _restore_wheel(saved: Mapping[str, Any]) -> _Wheel:
        wheel = _Wheel()
        baselines = saved["baselines"].items()
        if saved["rate_hz"] is None:
            return wheel
        wheel.rate_hz = float(saved["rate_hz"])
        if not 1.0 <= wheel.rate_hz <= 10_000.0:
            raise ValueError("the saved resonances have an absurd sampling rate")
        if baselines:
            wheel.ring.restore(float(saved["ring_scale"]))
        for name, entry in baselines:
            bins = bins_hz(wheel.rate_hz).size
            number, learned = int(name), Spectrum.from_json(entry, bins)
            if not (0 <= number < len(SPEED_CLASSES_MPS) and PeakFit.max_frequency_hz(wheel.rate_hz) > 0.0):
                raise ValueError("the saved resonances are of another signal")
            baseline = PeakFit(wheel.rate_hz).fit(learned)
            wheel.classes[number] = _Class(Spectrum.empty(bins), learned, baseline)
        return wheel


def _finite_or_none(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
