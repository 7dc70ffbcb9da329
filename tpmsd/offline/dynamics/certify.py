"""A certificate for each finding: how often a drive without it would show as much.

In: a finished selection and its findings. Out: the findings with p-values counted in replicates, and a
`Certificate`.

Parametric bootstrap through the whole analysis (Davison and Hinkley, Bootstrap Methods and their Application,
1997, section 4.2): a replicate is drawn from the fitted model without the finding, on the recorded inputs,
with the fitted noise of states, disturbances and readings. Noise, path and the other terms are fitted to it
again, and all alternatives are asked, those over covariates and time too. The statistic is the log evidence;
its null distribution is that of the largest one of any alternative, so that their number is accounted for
(Westfall and Young, Resampling-Based Multiple Testing, 1993).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.baselines.base import Theta
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.robustness.p_value import (
    PValue,
    count_reaching,
    discoveries,
    estimate_p_value,
    is_decided,
)
from tpmsd.offline.dynamics.drive import DynamicsDrive
from tpmsd.offline.dynamics.located import located_terms, nameless_penalty
from tpmsd.offline.dynamics.noise import PathNoise
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.predict import free_run, outputs_along
from tpmsd.offline.dynamics.result import FINDING, SUSPICION, Certificate, DynamicsFinding
from tpmsd.offline.dynamics.search import Search
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.terms import CandidateTerm


@dataclass(frozen=True)
class Replicates:
    """Budget of replicates for one question, and their generator."""

    most: int
    rng: np.random.Generator


def certify_findings(
    search: Search,
    findings: Sequence[DynamicsFinding],
    replicates: Replicates,
    say: Callable[[float], None] = lambda share: None,
) -> tuple[tuple[DynamicsFinding, ...], Certificate]:
    """Return the findings with p-values by replicates, and the certificate with what is left."""
    rng = replicates.rng
    p_values: list[PValue] = []
    drawn = 0
    for k, one in enumerate(findings):
        value = one.evidence - (nameless_penalty(search) if one.effect == "unknown" else 0.0)
        maxima = _largest_evidences(search, one.term, value, replicates.most, rng)
        drawn = max(drawn, len(maxima))
        p_values.append(estimate_p_value(value, maxima))
        say((k + 1) / (len(findings) + 1))
    left = largest_evidence(search)
    maxima = _largest_evidences(search, None, left, replicates.most, rng)
    certain = discoveries([one.tail for one in p_values], SETTINGS.false_discovery_rate)
    judged = tuple(
        replace(
            finding,
            p_value=one.p_value,
            p_value_is_bound=one.is_bound,
            status=FINDING if is_certain and finding.status == FINDING else SUSPICION,
        )
        for finding, one, is_certain in zip(findings, p_values, certain, strict=True)
    )
    rest = estimate_p_value(left, maxima)
    return judged, Certificate(
        max(drawn, len(maxima)), left, rest.p_value, count_reaching(left, maxima), len(maxima)
    )


def _largest_evidences(
    search: Search, without: int | None, value: float, most: int, rng: np.random.Generator
) -> list[float]:
    """Return the largest log evidence found in each replicate; drawing stops once `value` is decided."""
    terms = [term for k, term in enumerate(search.terms) if k != without]
    maxima: list[float] = []
    for _ in range(most):
        maxima.append(largest_evidence(_fit_replicate(search, terms, rng)))
        if is_decided(value, maxima):
            break
    return maxima


def _fit_replicate(search: Search, terms: Sequence[CandidateTerm], rng: np.random.Generator) -> Search:
    """Return the search fitted (noise, path, terms) to a replicate drawn from a model with these terms."""
    setup = search.setup
    theta = (*search.base, *(term.effect for term in terms))
    drive = replicate(search, theta, rng)
    again = Search(Setup(setup.baseline, drive, setup.channels), search.fixed, search.simulated, list(terms))
    again.fit()
    return again


def largest_evidence(search: Search) -> float:
    """Return the largest log evidence of anything that may be added to a model."""
    look = search.look(search.offered())
    scores = [look.score(k) for k in range(len(look.offered))]
    scores += [located.evidence for located in located_terms(search)]
    return float(max([score for score in scores if np.isfinite(score)], default=0.0))


def replicate(search: Search, theta: Theta, rng: np.random.Generator) -> DynamicsDrive:
    """Return the drive with readings simulated from a model and its fitted noise.

    Blocks start in the states of the fitted path; what is missing in the recording is missing here.
    """
    setup, noise = search.setup, search.noise
    names, all_names = setup.states(theta), setup.states(search.theta)
    start = search.at.path[:, [all_names.index(name) for name in names]]
    own = noise.for_states(names)
    drive = setup.drive
    dt = np.where(drive.linked, np.diff(drive.time_s), 0.0)
    deviation = np.sqrt(own.step_variance(dt))
    kicks = deviation * rng.standard_normal(deviation.shape)
    free = _disturbances(setup, own, kicks[:, len(names) :], rng)
    states = free_run(setup, theta, start, free, kicks[:, : len(names)])
    readings = outputs_along(setup, theta, states, setup.channels, free)
    readings = readings + own.outputs * rng.standard_normal(readings.shape)
    outputs = dict(drive.outputs)
    for k, name in enumerate(setup.channels):
        outputs[name] = np.where(np.isfinite(drive.outputs[name]), readings[:, k], np.nan)
    out = replace(drive, outputs=outputs)
    out.__dict__["moving"] = drive.moving
    return out


def _disturbances(setup: Setup, noise: PathNoise, kicks: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return simulated disturbances (n, d), stationary from the first row of each block."""
    drive = setup.drive
    step = float(np.median(np.diff(drive.time_s)))
    decay = float(np.exp(-step / SETTINGS.disturbance_time_s))
    out = np.zeros((len(drive.time_s), len(noise.disturbance)))
    starts, ends = drive.starts, drive.ends
    out[starts] = noise.disturbance * rng.standard_normal((len(starts), len(noise.disturbance)))
    for k in range(int((ends - starts).max()) - 1):
        rows = starts[starts + k + 1 < ends] + k
        out[rows + 1] = decay * out[rows] + kicks[rows]
    return out
