"""Effects that a recording holds and the user's own simulation of it does not.

In: a `Regression` of the two, examined as two drives are. Out: the `Selection` of differences, and what each
of the two holds. The simulation takes the rolling model's place: whatever both hold in common (an effect's
value is then one number for both) becomes part of the baseline, and only terms that act in the recording
alone are findings. A finding's effect is also free in the baseline, so that its value is the recording's less
the simulation's, with the doubt of both: what is too faint to be seen in the simulation is not said to be
missing from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.joint_terms import JointHypotheses
from tpmsd.offline.diagnosis.hypotheses.terms import CarLimits, Hypotheses, Term
from tpmsd.offline.diagnosis.prepared.drive_regression import Refined, refined
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence, LeastSquaresFit
from tpmsd.offline.inference.noise import Noise

RECORDING, SIMULATION, BOTH = "recording", "simulation", "both"
MEMORIES = {
    "speed_memory": "speed_mps",
    "slow_tau_s": "slow_m",
    "clock_tau_s": "clock_s",
    "radius_drift_tau_s": "radius_drift",
}
"""Memory of a noise, and the noise."""


@dataclass(frozen=True)
class CommonEffect:
    """An effect that recording and simulation share."""

    term: Term
    """Its design acts in both."""

    @property
    def key(self) -> tuple[str, ...]:
        """Return effect, wheels, pattern and covariate: what identifies it in either drive."""
        return drive_independent_key(self.term)


@dataclass(frozen=True)
class EffectDifference:
    """One difference: who holds the effect, and the values of each."""

    by: str
    recorded: Chosen
    simulated: Chosen
    shared_effect: CommonEffect | None


class Differences(Hypotheses):
    """Terms that act in the recording alone; calibration and what both hold in common is the baseline."""

    def __init__(self, joint: JointHypotheses, common: Sequence[CommonEffect]) -> None:
        """A difference may have either sign, so that the limits of an effect's values do not hold for it."""
        self.joint = joint
        self.common = list(common)
        super().__init__(
            nuisance=np.concatenate([joint.nuisance, *(one.term.design for one in common)], axis=1),
            catalogue=[term for term in joint.catalogue if term.drive == 0],
            splines=joint.splines_of(0),
            car=CarLimits(radius_m=joint.car.radius_m, driven=joint.car.driven),
        )

    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the gain of each ramp that acts in the recording, with its term."""
        return [(gain, term) for gain, term in self.joint.ramp_gains(gram, b) if term.drive == 0]

    def pulse_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the gain of each pulse that acts in the recording, with its term."""
        return [(gain, term) for gain, term in self.joint.pulse_gains(gram, b) if term.drive == 0]

    def first_value_index(self, which: CommonEffect) -> int:
        """Return the index in a fit of a common effect's first value."""
        before = self.common[: [one.key for one in self.common].index(which.key)]
        return int(self.joint.nuisance.shape[1] + sum(one.term.design.shape[1] for one in before))


def drive_independent_key(term: Term) -> tuple[str, ...]:
    """Return effect, wheels, pattern and covariate, which identify a term in any drive."""
    return (term.effect, term.wheel, term.pattern, term.covariate)


def floored_noise(noise: Noise, recorded: Noise) -> Noise:
    """Return a simulation's noise, each standard deviation at least a fixed fraction of the recording's."""
    changes: dict[str, Any] = {}
    for field in fields(Noise):
        mine, theirs = getattr(noise, field.name), getattr(recorded, field.name)
        if isinstance(mine, tuple):
            changes[field.name] = tuple(
                max(a, SETTINGS.assessment.simulation_floor * b) for a, b in zip(mine, theirs, strict=True)
            )
        elif field.name not in MEMORIES:
            changes[field.name] = max(mine, SETTINGS.assessment.simulation_floor * theirs)
    for memory, size in MEMORIES.items():
        if getattr(noise, size) < SETTINGS.assessment.simulation_floor * getattr(recorded, size):
            changes[memory] = getattr(recorded, memory)
    return replace(noise, **changes)


def select_differences(
    regression: Regression, selection: Selection, evidence: Evidence
) -> tuple[Selection, Evidence]:
    """Return the terms by which recording and simulation differ, and their evidence; the regression's
    hypotheses are `Differences` from then on.
    `selection` is that of recording and simulation as two drives.
    """
    joint = regression.hypotheses
    assert isinstance(joint, JointHypotheses)
    common: list[CommonEffect] = []
    silent: set[tuple[str, ...]] = set()
    evidence = _move_to_common(
        regression, joint, evidence, [one.term for one in selection.chosen], common, silent
    )
    for last in (*[False] * SETTINGS.assessment.simulation_rounds, True):
        regression.hypotheses = Differences(joint, common)
        selector = Selector(evidence, regression.hypotheses)
        found = selector.select()
        free = [one.term for one in found.chosen if not _is_settled(one.term, common, silent)]
        if not free:
            return found, evidence
        if last:
            settled = [one.term for one in found.chosen if _is_settled(one.term, common, silent)]
            return selector.selection_of(settled), evidence
        regression.hypotheses = joint
        evidence = _move_to_common(regression, joint, evidence, free, common, silent)
    raise AssertionError("unreachable")


def effect_differences(regression: Regression, selection: Selection) -> list[EffectDifference]:
    """Return, for each chosen difference, which side holds the effect and with which values; empty where
    there is no simulation."""
    hypotheses = regression.hypotheses
    if not isinstance(hypotheses, Differences):
        return []
    out = []
    start = hypotheses.nuisance.shape[1]
    for one in selection.chosen:
        at = np.arange(start, start + len(one.values))
        start += len(one.values)
        shared_effect = next((c for c in hypotheses.common if c.key == drive_independent_key(one.term)), None)
        shared = np.zeros((len(at), selection.fit.design.shape[1]))
        if shared_effect is not None:
            first = hypotheses.first_value_index(shared_effect)
            for k, name in enumerate(one.term.parameters):
                if name in shared_effect.term.parameters:
                    shared[k, first + shared_effect.term.parameters.index(name)] = 1.0
        both = shared.copy()
        both[np.arange(len(at)), at] = 1.0
        ratio = float(np.max(one.stds**2 / np.maximum(np.diag(selection.fit.covariance)[at], 1e-300)))
        simulated, there = _with_combined_values(one, selection.fit, shared, ratio)
        recorded, here = _with_combined_values(one, selection.fit, both, ratio)
        by = SIMULATION if there > max(here, SETTINGS.assessment.seen_stds) else RECORDING
        if min(there, here) > SETTINGS.assessment.seen_stds:
            by = BOTH
        out.append(EffectDifference(by, recorded, simulated, shared_effect))
    return out


def recorded_terms(regression: Regression, selection: Selection) -> list[Chosen]:
    """Return all terms that the recording holds, those in common with the simulation included; empty where
    there is no simulation."""
    hypotheses = regression.hypotheses
    if not isinstance(hypotheses, Differences):
        return []
    out: list[Chosen] = []
    taken = []
    for difference, one in zip(selection.chosen, effect_differences(regression, selection), strict=True):
        if difference.term.calibrates:
            continue
        same = one.shared_effect is not None and _has_same_nonlinear_values(
            one.shared_effect.term, one.recorded.term
        )
        if not same and one.shared_effect is not None:
            out.append(difference)
        elif one.by != SIMULATION:
            out.append(one.recorded)
        if same:
            taken.append(one.shared_effect)
    for common in hypotheses.common:
        if all(common is not one for one in taken) and not common.term.calibrates:
            at = hypotheses.first_value_index(common) + np.arange(common.term.design.shape[1])
            stds = np.sqrt(np.diag(selection.fit.covariance)[at])
            out.append(Chosen(common.term, 0.0, 0.0, 0.0, 1.0, (), selection.fit.values[at], stds))
    return out


def simulated_effects(regression: Regression, selection: Selection) -> tuple[str, ...]:
    """Return the names of the effects that the simulation holds, less those that it turned out to lack."""
    hypotheses = regression.hypotheses
    if not isinstance(hypotheses, Differences):
        return ()
    lacking = {
        drive_independent_key(one.recorded.term)
        for one in effect_differences(regression, selection)
        if one.by == RECORDING
    }
    seen = [one for one in hypotheses.common if one.key not in lacking and not one.term.calibrates]
    return tuple(dict.fromkeys(one.term.effect for one in seen))


def _has_same_nonlinear_values(one: Term, other: Term) -> bool:
    """Return whether two terms have the same parameters, times, nonlinear values and course."""
    return all(
        getattr(one, name) == getattr(other, name)
        for name in ("parameters", "span_s", "at", "second", "course")
    )


def _with_combined_values(
    one: Chosen, fit: LeastSquaresFit, into: FloatArray, ratio: float
) -> tuple[Chosen, float]:
    """Return a term whose values are combinations `into` of the fit's, and their distance from zero in
    standard deviations."""
    covariance = into @ fit.covariance @ into.T * ratio
    values = into @ fit.values
    return replace(one, values=values, stds=np.sqrt(np.diag(covariance))), _distance_from_zero(
        values, covariance
    )


def _distance_from_zero(values: FloatArray, covariance: FloatArray) -> float:
    """Return the distance of values from zero in standard deviations, reduced for the number of values."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    unit = covariance / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    square = float((values / scale) @ np.linalg.solve(unit, values / scale))
    return float(np.sqrt(max(square - (len(values) - 1), 0.0)))


def _is_settled(term: Term, common: Sequence[CommonEffect], silent: set[tuple[str, ...]]) -> bool:
    """Return whether a term is common to both drives already, or one on which the simulation has no
    information."""
    return drive_independent_key(term) in silent or any(
        one.key == drive_independent_key(term) and set(term.parameters) <= set(one.term.parameters)
        for one in common
    )


def _move_to_common(
    regression: Regression,
    joint: JointHypotheses,
    evidence: Evidence,
    terms: Sequence[Term],
    common: list[CommonEffect],
    silent: set[tuple[str, ...]],
) -> Evidence:
    """Add terms to `common`, or to `silent` where the simulation has no information about them, and return
    the evidence."""
    wanted = [term for term in terms if not _is_settled(term, common, silent)]
    exact = {term: _exact_columns(term) for term in wanted}
    columns: list[tuple[Refined, dict[int, FloatArray]]] = []
    for part in (part for term in wanted for part in exact[term]):
        by_drive = {k: part.column(drive.reader, drive.base) for k, drive in enumerate(regression.drives)}
        columns += [(part, by_drive), (part, {0: by_drive[0]})]
    indices = iter(regression.append(columns))
    if columns:
        evidence = regression.evidence()
        for k, one in enumerate(common):
            common[k] = CommonEffect(
                replace(one.term, design=widened_design(one.term.design, regression.width))
            )
    for term in wanted:
        design = _common_design(
            term,
            regression,
            joint,
            [[evidence.unit(next(indices)) for _ in ("tied", "alone")] for _ in exact[term]],
        )
        if (
            design is None
            or _information_ratio(evidence, joint.nuisance, design) < SETTINGS.assessment.simulation_silent
        ):
            silent.add(drive_independent_key(term))
            continue
        common[:] = [one for one in common if one.key != drive_independent_key(term)]
        common.append(CommonEffect(replace(term, design=design, drive=None)))
    return evidence


def _common_design(
    term: Term, regression: Regression, joint: JointHypotheses, columns: list[list[FloatArray]]
) -> FloatArray | None:
    """Return the design of a term that acts in both drives alike; None where the simulation has no column of
    it.
    `columns` are its exact columns, of both drives tied and of the recording alone; the latter become a
    hypothesis.
    """
    if columns:
        design, alone = (np.concatenate(each, axis=1) for each in zip(*columns, strict=True))
        joint.catalogue.append(replace(term, design=alone, drive=0))
        return design
    design = widened_design(term.design, regression.width)
    if term.drive is None:
        return design
    mirror = joint.design_in_other_drive(design, term.drive, 1 - term.drive)
    return None if mirror is None else design + mirror


def _exact_columns(term: Term) -> tuple[Refined, ...]:
    """Return the columns of a term that has an onset or a time constant, at its present values; none of other
    terms."""
    begin, end = term.span_s
    if term.ramp or term.pulse:
        return refined(term, begin, end - begin if term.ramp else end, term.course)
    return () if term.at is None else refined(term, term.at, term.second or 0.0)


def _information_ratio(evidence: Evidence, nuisance: FloatArray, design: FloatArray) -> float:
    """Return the smallest ratio, over a design's values, of the simulation's information to the
    recording's."""
    informations = []
    for part in evidence.parts:
        gram = part.small(np.concatenate([nuisance, design], axis=1)).sum(axis=0)[1:, 1:]
        used = np.flatnonzero(np.diag(gram)[: nuisance.shape[1]] > 0.0)
        new = np.arange(nuisance.shape[1], len(gram))
        scale = 1.0 / np.sqrt(np.diag(gram)[used])
        base = gram[np.ix_(used, used)] * np.outer(scale, scale) + 1e-9 * np.eye(len(used))
        cross = gram[np.ix_(used, new)] * scale[:, None]
        informations.append(np.diag(gram)[new] - (cross * np.linalg.solve(base, cross)).sum(axis=0))
    recorded, simulated = informations
    return float(np.min(simulated / np.maximum(recorded, 1e-300)))


def widened_design(design: FloatArray, width: int) -> FloatArray:
    """Return a design with zero rows (1 + width, k) for columns that were added since."""
    return np.concatenate([design, np.zeros((width - len(design), design.shape[1]))])
