"""The diagnosis of drives, from recordings to findings.

In: `Recording`s. Out: `Diagnosis`. Pure: the same recordings give the same answer.

1. Smooth each recording's own motion and predict all channels by the rolling model.
2. Whiten residuals and the responses of all hypotheses with the unknown motion eliminated.
3. Choose terms; estimate the noise from what they leave; repeat.
4. Refine the parameters that enter nonlinearly, and report.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tpmsd.diagnosis.channels import CHANNELS, Reader
from tpmsd.diagnosis.confirm import confirmed
from tpmsd.diagnosis.evidence import Evidence
from tpmsd.diagnosis.findings import report
from tpmsd.diagnosis.motion import reference
from tpmsd.diagnosis.noise_fit import fit_noise, outliers
from tpmsd.diagnosis.recording import Recording
from tpmsd.diagnosis.refine import refine
from tpmsd.diagnosis.response import (
    catalogue_columns,
    radius_columns,
    ramp_columns,
    ramp_knots,
    smooth_columns,
    smooth_knots,
)
from tpmsd.diagnosis.result import INSUFFICIENT, Diagnosis
from tpmsd.diagnosis.selection import Selection, Selector
from tpmsd.diagnosis.terms import Hypotheses, Name
from tpmsd.diagnosis.whitening import Noise, whiten
from tpmsd.physics.model import ExtendedModel
from tpmsd.wheels import RL, RR, FloatArray

MIN_DRIVING_S = 90
BLOCK_S = 30
MIN_BLOCKS = 10


class Study:
    """One drive's residual, columns and noise, and the evidence they make."""

    def __init__(self, reader: Reader) -> None:
        self.reader = reader
        windows = reader.windows
        residual = windows.measured - reader.predict(ExtendedModel())
        self.smooth_knots = smooth_knots(windows.covariates)
        smooth = smooth_columns(reader, self.smooth_knots)
        parts = [radius_columns(reader), catalogue_columns(reader), ramp_columns(reader), smooth]
        self.names: list[Name] = [("data",)] + [name for part in parts for name in part.names]
        self.columns = np.concatenate(
            [residual[:, :, None], *(part.stack() for part in parts if part.names)], axis=2
        )
        self.noise = first_noise(reader)
        self.inflate: FloatArray | None = None
        self.hypotheses = Hypotheses(self.names, ramp_knots(reader), unusable(reader))
        count = max(MIN_BLOCKS, round(len(windows) / BLOCK_S))
        self.blocks = np.arange(len(windows)) * count // len(windows)
        self.white = np.zeros(0)
        self.log_variance = 0.0

    def evidence(self) -> Evidence:
        """Whiten everything with the present noise."""
        self.white, self.log_variance = whiten(self.reader.windows, self.noise, self.columns, self.inflate)
        return Evidence(self.white, self.blocks)

    def believed(self, design: FloatArray) -> FloatArray:
        """(w, 9, 1 + k) the data and the columns of a design, for the noise's estimate."""
        return np.concatenate([self.columns[:, :, :1], self.columns @ design], axis=2)

    def residual(self, design: FloatArray, values: FloatArray) -> FloatArray:
        """(w, 9) whitened residual of a fit."""
        return np.asarray(self.white[:, :, 0] - self.white @ (design @ values))


def diagnose(
    recordings: Sequence[Recording], progress: Callable[[float], None] = lambda share: None
) -> Diagnosis:
    """Diagnose one drive (of several, the one with most driving is examined; see `docs/diagnosis.md`)."""
    readers = []
    reason = "no drive"
    for recording in recordings:
        reason = unfit(recording)
        if reason:
            continue
        reader = Reader(recording, reference(recording))
        reason = unfit_windows(reader)
        if not reason:
            readers.append(reader)
    if not readers:
        return insufficient(reason)
    reader = max(readers, key=lambda one: len(one.windows))
    study = Study(reader)
    progress(0.2)
    selection, evidence = examine(study, progress)
    progress(1.0)
    return report(study, selection, evidence)


def examine(study: Study, progress: Callable[[float], None]) -> tuple[Selection, Evidence]:
    """Choose terms and estimate the noise in turn."""
    windows = study.reader.windows
    design = study.hypotheses.nuisance
    for turn in range(2):
        study.noise = fit_noise(windows, study.believed(design), study.noise, turn == 0, study.inflate)
        evidence = study.evidence()
        progress(0.35 + 0.25 * turn)
        selection = Selector(evidence, study.hypotheses).select()
        if refine(study, selection, evidence):
            evidence = study.evidence()
            selection = Selector(evidence, study.hypotheses).select()
        white = study.residual(selection.fit.design, selection.fit.values)
        study.inflate = outliers(white, study.blocks, study.inflate)
        design = selection.fit.design
    study.noise = fit_noise(windows, study.believed(design), study.noise, False, study.inflate)
    evidence = study.evidence()
    return confirmed(study, Selector(evidence, study.hypotheses).select(), evidence)


def first_noise(reader: Reader) -> Noise:
    """Where the estimate of the noise starts: known quantisation, typical instruments."""
    quantum = reader.recording.quantum_rad / np.sqrt(2.0) * reader.reference.car.radius_m
    reading = tuple(float(q) for q in np.maximum(quantum, 1e-4))
    return Noise(reading_m=(reading[0], reading[1], reading[2], reading[3]))


def unusable(reader: Reader) -> frozenset[str]:
    """Effects of which this drive holds no trace whatever: without a gyro no gyro error."""
    out = set()
    known = np.isfinite(reader.windows.measured).sum(axis=0) > 30
    if not known[4]:
        out |= {"yaw_rate_bias", "yaw_rate_scale"}
    if not reader.reference.grade_known:
        out.add("road_grade")
    if not known[5:].any():
        out |= {"gnss_latency", "antenna_lever_arm", "lateral_slip", "road_grade"}
    return frozenset(out)


def unfit(recording: Recording) -> str:
    """Why a recording cannot be examined at all; empty if it can."""
    if not {RL, RR} <= set(recording.wheels):
        return "the rear wheels are not both read"
    if recording.ticks * recording.dt_s < MIN_DRIVING_S:
        return f"the drive is shorter than {MIN_DRIVING_S} s"
    return ""


def unfit_windows(reader: Reader) -> str:
    """Why too little is left to compare; empty if there is enough."""
    windows = reader.windows
    if len(windows) < MIN_DRIVING_S:
        return f"only {len(windows)} s of driving with all wheels read, {MIN_DRIVING_S} s are needed"
    gnss = np.isfinite(windows.measured[:, 5:CHANNELS]).any(axis=1).sum()
    if gnss < MIN_DRIVING_S / 2:
        return f"the receiver speaks in only {gnss} s of the driving"
    return ""


def insufficient(reason: str) -> Diagnosis:
    """The answer where there is nothing to go by."""
    return Diagnosis(
        verdict=INSUFFICIENT,
        reason=reason,
        findings=(),
        driving_s=0.0,
        baseline_rms=float("nan"),
        baseline_loglik_per_s=float("nan"),
        model_rms=float("nan"),
        unexplained=None,
        model=ExtendedModel(),
    )
