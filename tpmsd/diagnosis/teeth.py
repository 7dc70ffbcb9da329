"""Uneven or miscounted teeth of any drive as findings.

In: a `Study` and the calibration fitted to it. Out: `Finding`s. They are looked for apart from all else, at
the ticks' edges (`tone_ring`).
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.diagnosis.evidence import Fit
from tpmsd.diagnosis.result import Finding, Quantity, Where
from tpmsd.diagnosis.study import Study
from tpmsd.diagnosis.tone_ring import ADMIT, Ripple, ripples, wrong_teeth
from tpmsd.diagnosis.where import PLACE
from tpmsd.wheels import WHEELS

CHANNEL, COVARIATE = PLACE["tone_ring_error"]


def teeth(study: Study, calibration: Fit, seconds: float) -> list[Finding]:
    """The wheels whose teeth are uneven in some drive, or of the wrong number in all."""
    choice = math.log(len(study.drives))
    by_wheel: dict[str, list[Ripple]] = {}
    for drive in study.drives:
        for ripple in ripples(drive.reader.recording, drive.reader.reference):
            if ripple.gain >= 0.5 * ADMIT + choice:
                by_wheel.setdefault(ripple.wheel, []).append(ripple)
    out = [_uneven(found, seconds) for found in by_wheel.values()]
    return out + [_miscounted(name, teeth) for name, teeth in _wrong(study, calibration)]


def _uneven(found: list[Ripple], seconds: float) -> Finding:
    """One ring in the drives that show it; the phase is that of the first, for angles start anew."""
    weight = np.array([one.std_rad**-2 for one in found])
    gain = sum(one.gain for one in found)
    amplitude = float(np.average([one.amplitude_rad for one in found], weights=weight))
    first = found[0]
    return Finding(
        effect="tone_ring_error",
        confidence=1.0 - math.exp(-gain),
        parameters={
            "wheel": Quantity(first.wheel, None, ""),
            "amplitude_rad": Quantity(amplitude, float(weight.sum() ** -0.5), "rad"),
            "phase_rad": Quantity(first.phase_rad, first.phase_std_rad, "rad"),
        },
        where=Where((first.wheel,), CHANNEL, COVARIATE, (0.0, 2.0 * math.pi)),
        rms_before=first.rms_before,
        rms_after=first.rms_after,
        loglik_gain_per_s=gain / seconds,
        gain=gain,
        indistinguishable_from=(),
    )


def _wrong(study: Study, calibration: Fit) -> list[tuple[str, float]]:
    """Wheels that every drive shows with the same wrong number of teeth."""
    found: list[set[tuple[str, float]]] = []
    at = 0
    for drive in study.drives:
        recording = drive.reader.recording
        radii = drive.reader.reference.car.radius_m.copy()
        for k, wheel in enumerate(recording.wheels):
            radii[wheel] += calibration.values[at + k]
        found.append(set(wrong_teeth(recording, radii)))
        at += sum(name[0] in ("radius", "gyro_delay") for name in drive.names)
    return sorted(set.intersection(*found), key=lambda entry: WHEELS.index(entry[0]))


def _miscounted(name: str, teeth: float) -> Finding:
    return Finding(
        effect="tone_ring_error",
        confidence=0.9,
        parameters={
            "wheel": Quantity(name, None, ""),
            "teeth_per_rev": Quantity(teeth, 0.0, "1"),
        },
        where=Where((name,), CHANNEL, None, None),
        rms_before=1.0,
        rms_after=1.0,
        loglik_gain_per_s=0.0,
        gain=0.0,
        indistinguishable_from=(),
        advice="count the ring's teeth: a tyre of another size looks the same on the bus",
    )
