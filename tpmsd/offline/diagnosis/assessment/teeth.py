"""Uneven or miscounted teeth of any drive as findings.

In: a `Regression` and the calibration fitted to it. Out: `Finding`s. They are looked for apart from all else,
at the ticks' edges (`rings.uneven_teeth`, `rings.miscount`).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tpmsd.car.physics.catalogue import ALWAYS, RADIUS, TEETH
from tpmsd.car.physics.effect import Parameter
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.diagnosis.assessment.result import Finding, Quantity, Where
from tpmsd.offline.diagnosis.assessment.simulated import BOTH, RECORDING
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import LeastSquaresFit
from tpmsd.offline.rings.miscount import wheels_with_wrong_teeth
from tpmsd.offline.rings.uneven_teeth import Ripple, ripples

ALL = ""
"""Name of all wheels together."""
RING = "ripple of the ring"
"""The search of this module, as `Finding.found_by` names it."""
CHANNEL, COVARIATE = TEETH.identification.shows_in


def tooth_findings(regression: Regression, calibration: LeastSquaresFit, seconds: float) -> list[Finding]:
    """Return findings of wheels whose teeth are uneven in some drive, or whose number of teeth is wrong in
    all.
    Compared with a simulation: those of the recording that the simulation does not hold alike.
    """
    choice = math.log(len(regression.drives))
    by_wheel: dict[str, list[Ripple]] = {}
    for drive in regression.examined:
        for ripple in ripples(drive.reader.recording, drive.reader.reference):
            if ripple.gain >= 0.5 * SETTINGS.counters.ripple_admit_nats + choice:
                by_wheel.setdefault(ripple.wheel, []).append(ripple)
    wrong = _wrong_tooth_numbers(regression, calibration)
    configured = regression.drives[0].reader.recording.car.teeth_per_rev
    out = [_uneven_finding(found, seconds) for found in by_wheel.values()]
    if not regression.simulation:
        return out + [
            _tooth_number_finding(name, count, configured) for name, count in sorted(set.intersection(*wrong))
        ]
    simulated = regression.drives[1].reader
    rings = {ring.wheel: ring for ring in ripples(simulated.recording, simulated.reference)}
    beyond = [
        one for one in (_without_simulated_ripple(finding, rings) for finding in out) if one is not None
    ]
    miscounted = [
        _tooth_number_finding(name, count, configured) for name, count in sorted(wrong[0] - wrong[1])
    ]
    return beyond + [replace(finding, held_by=RECORDING) for finding in miscounted]


def ordinary_ring_note(finding: Finding, speeds: bool) -> str:
    """Return a note on a tone ring whose pitch errors are within tolerance; empty where it is a finding.

    `speeds` says that the bus has wheel speeds and no counts.
    """
    amplitude = finding.parameters.get("amplitude_rad")
    if finding.effect != TEETH.name or amplitude is None:
        return ""
    assert isinstance(amplitude.value, float)
    note = TEETH.tolerance_note(amplitude.value, amplitude.std or 0.0, speeds)
    return note and f"the ring of {finding.parameters['wheel'].value}: {note}"


def _without_simulated_ripple(finding: Finding, simulated: dict[str, Ripple]) -> Finding | None:
    """Return a finding less the ripple that the simulation holds; None if nothing significant is left."""
    ring = simulated.get(str(finding.parameters["wheel"].value))
    if ring is None:
        return replace(finding, held_by=RECORDING)
    mine = finding.parameters["amplitude_rad"]
    assert isinstance(mine.value, float)
    assert mine.std is not None
    std = math.hypot(mine.std, ring.std_rad)
    if abs(mine.value - ring.amplitude_rad) < SETTINGS.assessment.seen_stds * std:
        return None
    more = Quantity(mine.value - ring.amplitude_rad, std, "rad")
    theirs = Quantity(ring.amplitude_rad, ring.std_rad, "rad")
    return replace(
        finding,
        parameters={**finding.parameters, "amplitude_rad": more},
        simulated={"amplitude_rad": theirs},
        held_by=BOTH,
    )


def _uneven_finding(found: list[Ripple], seconds: float) -> Finding:
    """Return one wheel's uneven ring as a finding from the drives that show it; the phase is that of the
    first drive."""
    weight = np.array([one.std_rad**-2 for one in found])
    gain = sum(one.gain for one in found)
    amplitude = float(np.average([one.amplitude_rad for one in found], weights=weight))
    first = found[0]
    return Finding(
        effect=TEETH.name,
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
        found_by=RING,
    )


def _wrong_tooth_numbers(
    regression: Regression, calibration: LeastSquaresFit
) -> list[set[tuple[str, float]]]:
    """Return, for each drive, the set of (wheel, number of teeth) that differ from the configured number.
    A wheel of no name stands for all four.
    """
    found: list[set[tuple[str, float]]] = []
    at = 0
    for drive in regression.drives:
        recording = drive.reader.recording
        radii = drive.reader.reference.car.radius_m.copy()
        for k, wheel in enumerate(recording.wheels):
            radii[wheel] += calibration.values[at + k]
        counts = dict(zip(WHEELS, recording.counts_per_rev, strict=True))
        plain = {(wheel, count) for wheel, count in counts.items() if count is not None}
        if len(plain) == len(WHEELS) and len(set(counts.values())) == 1:
            plain = {(ALL, count) for _, count in plain}
        faint = [] if plain else wheels_with_wrong_teeth(recording, radii)
        found.append({*plain, *faint})
        at += sum(name[0] in ALWAYS for name in drive.names)
    return found


def _tooth_number_finding(name: str, teeth: float, configured: float) -> Finding:
    """Return the wrong number of teeth of a wheel, or of all four, as a finding."""
    of_wheel = {} if name == ALL else {"wheel": Quantity(name, None, "")}
    (radius,) = (p for p in RADIUS.parameters if isinstance(p, Parameter))
    assert radius.prior is not None
    # A radius that is off by so much is the other explanation: what is known of radii speaks against it.
    gain = 0.5 * ((configured / teeth - 1.0) * SETTINGS.counters.nominal_radius_m / radius.prior.std) ** 2
    return Finding(
        effect=TEETH.name,
        confidence=1.0 / (1.0 + math.exp(-min(gain, 50.0))),
        parameters={**of_wheel, "teeth_per_rev": Quantity(teeth, 0.0, "1")},
        where=Where(WHEELS if name == ALL else (name,), "wheel" if name == ALL else CHANNEL, None, None),
        rms_before=1.0,
        rms_after=1.0,
        loglik_gain_per_s=0.0,
        gain=gain,
        indistinguishable_from=(),
        found_by=RING,
        advice="count the ring's teeth: a tyre of another size looks the same on the bus",
    )
