"""Counts that are lost as findings.

In: a `Study`. Out: `Finding`s. They are looked for apart from all else: at walking pace below the speeds of
the windows (`counters.low_speed`), while a wheel turns by the rings' ripple (`counters.missed`).
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.diagnosis.assessment.result import Finding, Quantity, Where
from tpmsd.diagnosis.counters.low_speed import Lost, lost_counts
from tpmsd.diagnosis.counters.missed import Missed, missed_counts
from tpmsd.diagnosis.prepared.study import Study
from tpmsd.diagnosis.settings import SETTINGS
from tpmsd.physics.catalogue import LOST, MISSED, TEETH
from tpmsd.wheels import WHEELS


def lost(study: Study, seconds: float) -> list[Finding]:
    """The counts that some drive's wheels lose at low speed, by the drive that tells it best."""
    found = [
        one
        for drive in study.examined
        if (one := lost_counts(drive.reader.recording, drive.reader.reference.car.radius_m)) is not None
    ]
    return [] if not found else [_lost_finding(max(found, key=lambda one: one.gain), seconds)]


def _lost_finding(one: Lost, seconds: float) -> Finding:
    sure = one.gain - SETTINGS.counters.lost_admit_nats
    return Finding(
        effect=LOST.name,
        confidence=1.0 / (1.0 + math.exp(-float(np.clip(sure, -50.0, 50.0)))),
        parameters={
            "wheels": Quantity(" ".join(one.wheels), None, ""),
            "below_mps": Quantity(one.below_mps, one.below_std_mps, "m/s"),
            "lost": Quantity(one.share, one.share_std, "1"),
        },
        where=Where(one.wheels, *LOST.shows_in, one.speeds_mps),
        rms_before=1.0,
        rms_after=1.0,
        loglik_gain_per_s=one.gain / seconds,
        gain=one.gain,
        indistinguishable_from=(),
    )


def missed(study: Study, seconds: float) -> list[Finding]:
    """The wheels that lose counts while they turn, in each drive that shows it: how many is the day's own."""
    out = []
    for drive in study.examined:
        recording = drive.reader.recording
        name = (recording.name,) if len(study.examined) > 1 else ()
        for one in missed_counts(recording, drive.reader.reference):
            out.append(_missed_finding(one, name, seconds))
    return out


def _missed_finding(one: Missed, drives: tuple[str, ...], seconds: float) -> Finding:
    return Finding(
        effect=MISSED.name,
        confidence=1.0 / (1.0 + math.exp(-min(one.gain - math.log(len(WHEELS)), 50.0))),
        parameters={
            "wheel": Quantity(one.wheel, None, ""),
            "rate_per_s": Quantity(one.rate_per_s, one.rate_std_per_s, "1/s"),
        },
        where=Where((one.wheel,), *TEETH.shows_in, (0.0, 2.0 * math.pi)),
        rms_before=1.0,
        rms_after=1.0,
        loglik_gain_per_s=one.gain / seconds,
        gain=one.gain,
        indistinguishable_from=(),
        drives=drives,
        told_by=(
            f"the ring's ripple, once per turn, comes every {one.per_turn:.0f} counts of"
            f" {one.whole_per_turn:.0f}; of a larger radius it would come every {one.whole_per_turn:.0f}"
        ),
        # The probability that a likelihood ratio of this size favours the wrong account is less than its
        # inverse; so many wheels were looked at.
        p_value=min(1.0, len(WHEELS) * math.exp(-one.gain)),
    )
