"""Gain that slips by the tyre model would bring.

In: a `Regression` and the terms that were found. Out: `Explanatory`: what wheel slip and side slip would
gain, alone and beyond these.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.result import Explanatory
from tpmsd.offline.diagnosis.hypotheses.group_gain import group_gain
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.hypotheses.wheel_slip import SIDE_SLIP, WHEEL_SLIP
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.inference.least_squares import Evidence
from tpmsd.offline.inference.windows import GYRO

SHOWN_OVER = {WHEEL_SLIP: "accel_long", SIDE_SLIP: "accel_lat"}


def slip_gains(regression: Regression, found: Sequence[Term], evidence: Evidence) -> tuple[Explanatory, ...]:
    """Return, for each slip of the tyre model, its gains in sample (nats) over calibration alone and over the
    found terms; no entry for a slip of which no drive has columns."""
    selector = Selector(evidence, regression.hypotheses)
    designs = (selector.design([]), selector.design(found))
    without = _missing_signals(regression)
    out = []
    for name, covariate in SHOWN_OVER.items():
        design = _slip_design(regression, name)
        if design.shape[1] == 0:
            continue
        alone, beyond = (max(group_gain(design[1:], *evidence.projected(known))[0], 0.0) for known in designs)
        out.append(Explanatory(name, covariate, alone, beyond, without))
    return tuple(out)


def _slip_design(regression: Regression, name: str) -> FloatArray:
    """Return the (1 + p, k) design of one slip's columns, over all drives that have them."""
    indices: dict[tuple[str, ...], int] = {}
    for drive in regression.drives:
        for at, local in zip(drive.here, drive.local, strict=True):
            if local < len(drive.names) and drive.names[local][0] == name:
                indices.setdefault(drive.names[local], int(at))
    design = np.zeros((regression.width, len(indices)))
    design[list(indices.values()), np.arange(len(indices))] = 1.0
    return design


def _missing_signals(regression: Regression) -> tuple[str, ...]:
    """Return the roles of bus signals that are missing, so that slips follow from wheels and receiver
    alone."""
    drives = regression.examined
    by = {drive.reader.reference.grade_by for drive in drives}
    turns = [bool(np.isfinite(drive.reader.windows.measured[:, GYRO]).any()) for drive in drives]
    accel = () if by == {"accelerometer"} else ("accel_long",)
    return accel if all(turns) else (*accel, "yaw_rate")
