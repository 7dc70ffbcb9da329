"""Intervals of a change of a radius by the joint likelihood of its onset, duration and size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.offline.diagnosis.test_change_or_drift import drifting
from tpmsd.offline.diagnosis.assessment.ramp_interval import _trial_ramps, interval_stds, ramp_stds
from tpmsd.offline.diagnosis.hypotheses.response import ramp_column
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.drive_regression import Refined
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.robustness.with_drift import fit_ramps_with_drift
from tpmsd.offline.diagnosis.selection.chosen import Chosen
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.inference.noise_fit import log_posterior, refit_radius_drift


def test_a_ramp_is_the_weighted_sum_of_ramps_between_neighbours() -> None:
    """Ramp and step between any two nodes, at any time."""
    nodes = np.array([0.0, 2.0, 3.0, 7.0])
    pairs = _trial_ramps(nodes, 2.0, 7.0)
    times = np.linspace(-1.0, 9.0, 41)
    steps = (times[:, None] >= nodes).astype(float)
    ramps = np.clip((times[:, None] - nodes[:-1]) / np.diff(nodes), 0.0, 1.0)

    assert (2.0, 7.0) == (pairs.begin_s[0], pairs.end_s[0])
    for begin, end, weights in zip(pairs.begin_s, pairs.end_s, pairs.weights, strict=True):
        ramp = (times - begin) / max(end - begin, 1e-9)
        expected = np.clip(ramp, 0.0, 1.0) if end > begin else (times >= begin).astype(float)
        assert np.concatenate([steps, ramps], axis=1) @ weights == pytest.approx(expected)


def test_a_slow_loss_beside_radii_that_drift_has_the_interval_that_holds_it() -> None:
    """-3 mm from 100 to 160 s, first taken for a step, beside a drift of 0.4 mm.

    Ramp and drift fitted in turn are likelier than the step by far, and the interval of each of the three
    values holds the true one.
    """
    regression = Regression(admitted_readers([drifting(-3e-3)])[0])
    drive = regression.drives[0]
    windows = drive.reader.windows
    step = ramp_column(drive.reader, 2, (122.0, 0.0))
    pattern = regression.append([(_step(122.0), {0: step})])[0]
    regression.hypotheses.add_ramp("rl", (122.0, 122.0), pattern)
    term = regression.hypotheses.catalogue[-1]
    plain = drive.data_and_design(Selector(regression.evidence(), regression.hypotheses).design([term]))
    noise = refit_radius_drift(windows, plain, replace(drive.noise, radius_drift=1e-3), None)
    before = log_posterior(windows, plain, noise, None)

    found, terms = fit_ramps_with_drift(regression.with_noise({0: noise}), [term])
    evidence = found.evidence()
    selector = Selector(evidence, found.hypotheses, last=True)
    here = found.drives[0]
    after = log_posterior(windows, here.data_and_design(selector.design(terms)), here.noise, None)
    selection = selector.selection_of(terms)
    stds = ramp_stds(found, selection, 0, [])

    one = selection.chosen[0]
    begin, end = one.term.span_s
    assert after > before + 10.0
    assert begin == pytest.approx(100.0, abs=1.96 * stds["onset_s"])
    assert end - begin == pytest.approx(60.0, abs=1.96 * stds["duration_s"])
    assert one.values[0] == pytest.approx(-3e-3, abs=1.96 * stds["deviation_m"])
    assert stds["onset_s"] > 3.0
    assert 60.0 > stds["duration_s"] > 3.0
    assert stds["deviation_m"] >= one.stds[0]


@pytest.mark.parametrize("overdispersion", [1.0, 4.0])
def test_the_interval_of_two_times_is_that_of_their_joint_normal_likelihood(overdispersion: float) -> None:
    """Of a quadratic log-likelihood, divided by the overdispersion c, the standard deviations are the roots
    of c times the inverse information's diagonal."""
    information = np.array([[0.5, 0.3], [0.3, 0.4]])
    off = np.linspace(-20.0, 20.0, 801)
    grid = np.stack(np.meshgrid(off, off), axis=2).reshape(-1, 2)
    trials = np.concatenate([np.zeros((1, 2)), grid])
    gains = 100.0 - 0.5 * np.einsum("ti,ij,tj->t", trials, information, trials)
    term = Term("radius_change", np.zeros((2, 1)), ("deviation_m",), 0.0)
    one = Chosen(term, 100.0, 100.0 / overdispersion, 0.0, 1.0, (), np.array([-2e-3]), np.array([1e-4]))
    sizes = np.full(len(trials), -2e-3)

    stds = interval_stds(one, gains, sizes, 100.0 + trials[:, 0], 60.0 + trials[:, 1])

    expected = np.sqrt(overdispersion * np.diag(np.linalg.inv(information)))
    assert [stds["onset_s"], stds["duration_s"]] == pytest.approx(expected, abs=0.05)
    assert stds["deviation_m"] == pytest.approx(1e-4)


def _step(at: float) -> Refined:
    return Refined((2,), at)
