"""Lost and added counts as findings.

In: a `Regression`. Out: `Finding`s. Three searches, apart from all other terms: at walking pace, below the
speeds of the windows (`rings.low_speed`); while a wheel turns, by the ripple of its ring (`rings.missed`);
one by one, by the scatter of the wheel's distance (`rings.single_losses`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tpmsd.car.physics.catalogue import ADDED, LOST, MISSED, TEETH
from tpmsd.car.rings.ring import count_length_m
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.diagnosis.assessment.result import Finding, Quantity, Where
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import LeastSquaresFit
from tpmsd.offline.rings.low_speed import LowSpeedLosses, low_speed_losses
from tpmsd.offline.rings.missed import MissedCounts, missed_counts
from tpmsd.offline.rings.single_losses import SingleLosses, single_losses

LOW_SPEED, RHYTHM, SINGLY = "low speed", "rhythm of the ring", "single counts"
"""The searches of this module, as `Finding.found_by` names them."""


def low_speed_loss_findings(regression: Regression, seconds: float) -> list[Finding]:
    """Return the finding of counts lost at low speed, of the drive with the largest gain; empty if no drive
    shows any."""
    found = low_speed_losses_of_drives(regression.examined)
    return [] if not found else [_low_speed_finding(max(found, key=lambda one: one.gain), seconds)]


def low_speed_losses_of_drives(drives: Sequence[DriveRegression]) -> list[LowSpeedLosses]:
    """Return the counts lost at low speed, one entry for each drive that shows them."""
    found = (
        low_speed_losses(drive.reader.recording, drive.reader.reference.car.radius_m) for drive in drives
    )
    return [one for one in found if one is not None]


def _low_speed_finding(one: LowSpeedLosses, seconds: float) -> Finding:
    """Return counts lost at low speed as a finding; its confidence is logistic in the gain over the
    threshold."""
    margin = one.gain - SETTINGS.counters.lost_admit_nats
    return Finding(
        effect=LOST.name,
        confidence=1.0 / (1.0 + math.exp(-float(np.clip(margin, -50.0, 50.0)))),
        parameters={
            "wheels": Quantity(" ".join(one.wheels), None, ""),
            "below_mps": Quantity(one.below_mps, one.below_std_mps, "m/s"),
            "lost": Quantity(one.share, one.share_std, "1"),
        },
        where=Where(one.wheels, *LOST.identification.shows_in, one.speeds_mps),
        rms_before=1.0,
        rms_after=1.0,
        loglik_gain_per_s=one.gain / seconds,
        gain=one.gain,
        indistinguishable_from=(),
        found_by=LOW_SPEED,
    )


def missed_count_findings(regression: Regression, seconds: float) -> list[Finding]:
    """Return a finding for each wheel and drive that loses counts while it turns; the rate is each drive's
    own."""
    out = []
    for drive in regression.examined:
        recording = drive.reader.recording
        name = (recording.name,) if len(regression.examined) > 1 else ()
        for one in missed_counts(recording, drive.reader.reference):
            out.append(_missed_finding(one, name, seconds))
    return out


def _missed_finding(one: MissedCounts, drives: tuple[str, ...], seconds: float) -> Finding:
    """Return lost counts of one wheel as a finding; its confidence allows for the choice among four
    wheels."""
    return Finding(
        effect=MISSED.name,
        confidence=1.0 / (1.0 + math.exp(-min(one.gain - math.log(len(WHEELS)), 50.0))),
        parameters={
            "wheel": Quantity(one.wheel, None, ""),
            "rate_per_s": Quantity(one.rate_per_s, one.rate_std_per_s, "1/s"),
        },
        where=Where((one.wheel,), *TEETH.identification.shows_in, (0.0, 2.0 * math.pi)),
        rms_before=1.0,
        rms_after=1.0,
        loglik_gain_per_s=one.gain / seconds,
        gain=one.gain,
        indistinguishable_from=(),
        drives=drives,
        identified_by=(
            f"the ring's ripple, once per revolution, comes every {one.counts_per_rev:.0f} counts of"
            f" {one.whole_per_revolution:.0f}; of a larger radius it would come every"
            f" {one.whole_per_revolution:.0f}"
        ),
        # The probability that a likelihood ratio of this size favours the wrong account is less than its
        # inverse; so many wheels were looked at.
        own_chance=min(1.0, len(WHEELS) * math.exp(-one.gain)),
        found_by=RHYTHM,
    )


def single_count_findings(regression: Regression, fit: LeastSquaresFit, seconds: float) -> list[Finding]:
    """Return a finding for each drive with a wheel that loses or adds counts one by one, jointly with the
    fitted model."""
    out = []
    for drive in regression.examined:
        one = single_losses_of(drive, fit)
        if one is not None:
            name = (drive.reader.recording.name,) if len(regression.examined) > 1 else ()
            out.append(_single_finding(one, name, seconds))
    return out


def single_losses_of(drive: DriveRegression, fit: LeastSquaresFit) -> SingleLosses | None:
    """Return the wheel of a drive that loses or adds counts one by one, jointly with a fit; None where none
    does."""
    recording, car = drive.reader.recording, drive.reader.reference.car
    per_rev = [one or car.teeth_per_rev for one in recording.counts_per_rev]
    count_m = np.where(recording.quantum_rad > 0.0, count_length_m(car.radius_m, np.array(per_rev)), 0.0)
    left = drive.unwhitened_residual(fit.design, fit.values)
    return single_losses(drive.reader.windows, left, count_m, drive.noise.gyro_radps)


def _single_finding(one: SingleLosses, drives: tuple[str, ...], seconds: float) -> Finding:
    """Return the finding of counts that a wheel loses (positive rate) or adds one by one."""
    kind, other = (MISSED, ADDED) if one.rate_per_s > 0.0 else (ADDED, MISSED)
    gain = one.gain + one.unlike
    return Finding(
        effect=kind.name,
        # Without a gyro a count more on one wheel is a count less on another: as likely, each.
        confidence=1.0 / (1.0 + len(one.similar_wheels) + math.exp(-min(one.gain, 50.0))),
        parameters={
            "wheel": Quantity(one.wheel, None, ""),
            "rate_per_s": Quantity(abs(one.rate_per_s), one.rate_std_per_s, "1/s"),
        },
        where=Where((one.wheel,), *kind.identification.shows_in, None),
        rms_before=1.0,
        rms_after=1.0,
        loglik_gain_per_s=gain / seconds,
        gain=gain,
        indistinguishable_from=(other.name,) if one.similar_wheels else (),
        drives=drives,
        identified_by=(
            f"its way {'falls back' if kind is MISSED else 'leaps ahead'} at random in steps of a count"
            f" (standard deviation {one.std:.2g} counts in a second); a radius makes no steps"
        ),
        own_chance=one.p_value,
        found_by=SINGLY,
    )
