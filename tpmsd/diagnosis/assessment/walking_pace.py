"""Counts lost at walking pace as findings.

In: a `Study`. Out: `Finding`s. They are looked for apart from all else, below the speeds of the windows
(`low_speed`).
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.diagnosis.assessment.result import Finding, Quantity, Where
from tpmsd.diagnosis.counters.low_speed import Lost, lost_counts
from tpmsd.diagnosis.prepared.study import Study
from tpmsd.diagnosis.settings import SETTINGS
from tpmsd.physics.catalogue import LOST


def lost(study: Study, seconds: float) -> list[Finding]:
    """The counts that some drive's wheels lose at low speed, by the drive that tells it best."""
    found = [
        one
        for drive in study.examined
        if (one := lost_counts(drive.reader.recording, drive.reader.reference.car.radius_m)) is not None
    ]
    return [] if not found else [_finding(max(found, key=lambda one: one.gain), seconds)]


def _finding(one: Lost, seconds: float) -> Finding:
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
