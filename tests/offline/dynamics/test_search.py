"""The state of the selection: paths with states that effects add, and what an attempt costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from tests.offline.dynamics.drives import folder, hidden, loaded
from tpmsd.car.physics.baselines.base import Theta
from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.offline.dynamics.columns import Probe, gram, model_derivatives, step_derivative
from tpmsd.offline.dynamics.findings import findings_of
from tpmsd.offline.dynamics.located import nameless
from tpmsd.offline.dynamics.model_statistics import ModelStatistics
from tpmsd.offline.dynamics.noise import least_noise
from tpmsd.offline.dynamics.path import Setup, path_log_likelihood, predicted_steps, smoothed
from tpmsd.offline.dynamics.search import Search
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.terms import CandidateTerm, term_of

CHANNELS = ("yaw_rate", "accel_lat", "velocity_lat")
ROLL = make_dynamics_effect("roll_dynamics", frequency_hz=1.5, damping=0.3)


def begun(tmp_path: Path, kind: type[Search] = Search, duration_s: float = 20.0) -> Search:
    """Return a selection without terms on a drive without hidden effects."""
    baseline, drive = loaded(folder(tmp_path / "d", hidden(), duration_s=duration_s), "single-track")
    return kind(Setup(baseline, drive, CHANNELS))


def test_a_path_with_roll_is_the_likeliest(tmp_path: Path) -> None:
    """A rolled acceleration of some m/s2 is reached from zero. Steps that are held back leave half a per
    cent of a nat; Newton's leave the square of what there was."""
    search = begun(tmp_path)
    search.terms = [term_of(ROLL, search.setup.baseline)]
    start = search._adapt_to_states(search.at.path)

    at = smoothed(search.setup, search.theta, start, search.noise)

    step = at.weighted(search.setup, search.noise)
    gradient = step.gradient()
    assert float(np.abs(at.path[:, 2]).max()) > 3.0
    assert float(np.vdot(gradient, step.factor.solve(gradient))) < 1e-5


@pytest.mark.parametrize("name", ["frequency_hz", "damping", "coupling"])
def test_columns_of_a_swinging_body_are_derivatives_of_its_steps(tmp_path: Path, name: str) -> None:
    """A slow car with such a body follows within less than a step: steps are derived through it."""
    search = begun(tmp_path)
    setup = search.setup
    slow = replace(setup.drive.inputs, speed_mps=0.5 * setup.drive.inputs.speed_mps)
    setup = replace(setup, drive=replace(setup.drive, inputs=slow))
    theta = (replace(ROLL, coupling=0.6),)
    noise = least_noise(setup.sizes(theta), setup.disturbances, search.noise.outputs)
    at = smoothed(setup, theta, setup.start(theta), noise)
    changed = (replace(theta[0], **{name: getattr(theta[0], name) + 1e-4}),)

    def ahead(model: Theta) -> np.ndarray:
        inputs, names = setup.inputs(model), setup.states(model)
        rates, _, _ = setup.evaluate(at.path, inputs, model, names)
        dt = np.diff(setup.drive.time_s)
        return predicted_steps(setup, model, at.path, inputs, dt, rates.T[:-1])[:, : len(names)]

    exact = (ahead(changed) - ahead(theta))[setup.drive.linked] / 1e-4
    by_rate, _ = model_derivatives(setup, theta, at, [Probe(changed, 1e-4)])
    found = step_derivative(at.by_rates, by_rate[0]).T[setup.drive.linked]

    assert np.all(np.std(found - exact, axis=0) < 0.1 * np.std(exact, axis=0))


def test_the_likelihood_of_a_swinging_body_counts_all_paths(tmp_path: Path) -> None:
    """Gradients by its parameters are those of the likelihood with all paths integrated: that of the
    likeliest path alone would let the body swing more than it does."""
    search = begun(tmp_path)
    search.terms = [term_of(ROLL, search.setup.baseline)]
    start = search._adapt_to_states(search.at.path)
    search.at = at = smoothed(search.setup, search.theta, start, search.noise)
    _, probes = search.own(0)
    found = gram(search.setup, search.theta, at, search.noise, probes)
    alone = gram(search.setup, search.theta, at, search.noise, [replace(probes[2], loosens=False)])
    rest, logs = (search.terms[0].at_rest(),), []
    for coupling in (0.395, 0.405):
        moved = smoothed(search.setup, (replace(ROLL, coupling=coupling),), at.path, search.noise)
        logs.append(path_log_likelihood(search.setup, moved, search.noise, rest))
    whole = (logs[1] - logs[0]) / 0.01

    assert found.gradient.sum(axis=0)[2] == pytest.approx(whole, rel=0.05)
    assert alone.gradient.sum() != pytest.approx(whole, rel=0.08)


def test_states_go_with_their_effects(tmp_path: Path) -> None:
    """Where one effect's states come before another's, those keep path and noise and the new have their
    sizes."""
    search = begun(tmp_path)
    slip = make_dynamics_effect("tyre_relaxation", length_m=0.5)
    search.terms = [term_of(slip, search.setup.baseline)]
    search.at = smoothed(search.setup, search.theta, search._adapt_to_states(search.at.path), search.noise)
    before, states = search.at.path, search.noise.states
    assert float(np.abs(before[:, 2:4]).max()) > 1e-3

    search.terms = [term_of(ROLL, search.setup.baseline), *search.terms]
    path = search._adapt_to_states(before)

    names = search.setup.states(search.theta)
    assert search.noise.states == names != states
    for name in states:
        assert path[:, names.index(name)].tolist() == before[:, states.index(name)].tolist()
    starts = dict(zip(names, search.noise.start, strict=True))
    assert [starts[name] for name in ROLL.states] == [10.0, 100.0]
    assert [starts[name] for name in slip.states] == [1.0, 1.0]
    assert search.noise.start == pytest.approx(search.floor.start)


class Judged(Search):
    """A selection whose prediction gets worse by a given amount with the tyres' relaxation."""

    worse: float
    asked: list[int]

    def prediction_error(self) -> float:
        """Return the error that is given."""
        return self.worse if any(term.name == "tyre_relaxation" for term in self.terms) else 0.0

    def _try_terms(self, terms: list[CandidateTerm], most: float) -> bool:
        self.asked.append(len(self.setup.drive.time_s))
        return super()._try_terms(terms, most)


def test_what_predicts_plainly_worse_on_a_part_is_not_fitted_to_the_whole_drive(tmp_path: Path) -> None:
    """Beside a name that is there; what is a little worse on the part is asked of the whole."""
    Judged.worse, Judged.asked = 0.0, []
    search = begun(tmp_path, Judged, 180.0)
    search.terms = [term_of(make_dynamics_effect("mass_error", relative=0.0), search.setup.baseline)]
    search.error, whole = 0.0, len(search.setup.drive.time_s)
    slip = term_of(make_dynamics_effect("tyre_relaxation", length_m=0.1), search.setup.baseline)

    for worse, asked in ((2.0, 1), (0.5, 2)):
        Judged.worse, Judged.asked = worse * SETTINGS.plain_error_increase, []
        assert not search.try_terms([*search.terms, slip])
        assert [count < whole for count in Judged.asked] == [True, False][:asked]


class Noted(Search):
    """A selection that notes how much of the catalogue each look offers."""

    offers: list[int]

    def _compute_statistics(self, offered: Sequence[CandidateTerm]) -> ModelStatistics:
        self.offers.append(len(offered))
        return super()._compute_statistics(offered)


def test_what_is_needless_goes_before_the_catalogue_is_looked_at(tmp_path: Path) -> None:
    """Its own columns say so; those of the whole catalogue take ten times as long."""
    Noted.offers = []
    search = begun(tmp_path, Noted)
    search.terms = [
        term_of(make_dynamics_effect(name, **values), search.setup.baseline)
        for name, values in (("mass_error", {"relative": 0.0}), ("yaw_rate_bias", {"bias": 0.0}))
    ]

    assert search.backward_or_exchange_step(8.0)

    assert len(search.terms) == 1
    assert Noted.offers == [0]


class Contested(Search):
    """A selection in which one name beats every term to first order, and none once it is fitted."""

    attempts: list[str]

    def look(self, offered: Sequence[CandidateTerm]) -> ModelStatistics:
        """Return evidence for every term, and more for that name."""
        better = term_of(make_dynamics_effect("gyro_delay", delay_s=0.0), self.setup.baseline)
        return Mock(evidence=lambda k: 50.0, competitors=lambda k: [(better, 60.0)])

    def try_terms(self, terms: list[CandidateTerm]) -> bool:
        """Refuse it."""
        self.attempts.append(terms[-1].name)
        return False


def test_a_name_that_predicts_worse_is_not_tried_in_the_place_of_each_term(tmp_path: Path) -> None:
    """Once in a pass over the terms."""
    Contested.attempts = []
    search = begun(tmp_path, Contested)
    search.terms = [
        term_of(make_dynamics_effect(name, **values), search.setup.baseline)
        for name, values in (("mass_error", {"relative": 0.1}), ("yaw_rate_bias", {"bias": 0.01}))
    ]

    assert not search.backward_or_exchange_step(8.0)

    assert Contested.attempts == ["gyro_delay"]


def test_confounded_terms_do_not_crowd_out_the_others(tmp_path: Path) -> None:
    """Two names for one thing count as one of the four that a forward step tries."""
    Contested.attempts = []
    search = begun(tmp_path, Contested)
    names = ["roll_steer", "camber_thrust", "yaw_rate_bias", "yaw_rate_scale", "gyro_delay", "mass_error"]
    terms = {term.name: term for term in search.offered()}

    ranked = [(terms[name], 20.0 - k) for k, name in enumerate(names)]

    assert not search._add_first(ranked, 7.0, search.rows)

    assert Contested.attempts == names[:5]
    assert set(search.rejected) == set(names[:5])


class Overstated(Contested):
    """A selection in which a term has far less evidence once it is fitted than it promised."""

    def look(self, offered: Sequence[CandidateTerm]) -> ModelStatistics:
        """Return hardly any evidence for every term."""
        return Mock(evidence=lambda k: 1.0, competitors=lambda k: [])

    def try_terms(self, terms: list[CandidateTerm]) -> bool:
        """Take it."""
        super().try_terms(terms)
        self.terms = terms
        return True


def test_a_term_that_promised_too_much_must_promise_more_to_be_fitted_again(tmp_path: Path) -> None:
    """One of 20 nats had 1 when fitted; it is fitted again if it promises 23, and not if 22, to keep 3.5."""
    Contested.attempts = []
    search = begun(tmp_path, Overstated)
    term = next(one for one in search.offered() if one.name == "gyro_delay")

    for promised in (20.0, 22.0, 23.0):
        assert not search._add_first([(term, promised)], 7.0, search.rows)
        assert search.rejected == {"gyro_delay": promised}

    assert Contested.attempts == ["gyro_delay", "gyro_delay"]
    assert search.terms == []


def test_a_tidy_pass_looks_at_a_part_first(tmp_path: Path) -> None:
    """There the scale of a gyro has no competitor; the forward step finds the answers."""
    where = folder(tmp_path / "d", hidden(yaw_rate_scale={"scale": 0.95}), duration_s=180.0)
    baseline, drive = loaded(where, "single-track")
    search = Search(Setup(baseline, drive, CHANNELS))
    search.terms = [one for one in search.offered() if one.name == "yaw_rate_scale"]
    search.fit_until_converged()

    assert not search.backward_or_exchange_step(8.0)

    assert search.cached_statistics.whole is None
    coarse = search._on_part_of_blocks()
    assert coarse is search._on_part_of_blocks()
    assert coarse.cached_statistics.whole is not None


def test_a_fit_stops_where_a_step_promises_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A two-hundredth of a nat is left aside, whatever values that moves."""
    search = begun(tmp_path)
    search.terms = [term_of(make_dynamics_effect("mass_error", relative=0.0), search.setup.baseline)]
    search.fit_until_converged()
    moved: list[float] = []
    monkeypatch.setattr("tpmsd.offline.dynamics.search.SETTINGS", replace(SETTINGS, settled=0.0))
    monkeypatch.setattr(search, "_move_terms", lambda step: moved.append(float(step[0])))

    search.fit()

    assert len(moved) == 1


class RunsAway(Search):
    """A selection whose likelihood grows with a delay without end, and whose prediction is best at 40 ms."""

    def fit(self, rounds: int = 3) -> None:
        """Go on by 15 ms."""
        self.terms = [term.moved(np.array([0.015])) for term in self.terms]

    def prediction_error(self) -> float:
        """Return a parabola over the delay."""
        return sum((term.value("delay_s") / 0.04 - 1.0) ** 2 for term in self.terms)


def test_a_model_settles_where_it_predicts_no_worse_than_at_the_start(tmp_path: Path) -> None:
    """From 20 ms on to 35 and 50 ms, and not to 65 ms; what stands with the values is theirs."""
    search = begun(tmp_path, RunsAway)
    search.terms = [term_of(make_dynamics_effect("gyro_delay", delay_s=0.02), search.setup.baseline)]
    search.error, at = search.prediction_error(), search.at

    search.fit_until_converged()

    assert search.terms[0].value("delay_s") == pytest.approx(0.05)
    assert search.error == pytest.approx(0.0625)
    assert search.at is at


def test_names_are_doubted_for_a_term_without_a_name_only_while_it_is_there(tmp_path: Path) -> None:
    """An exchange took it out: what was said of the names beside it holds no more."""
    where = folder(tmp_path / "d", hidden(gyro_delay={"delay_s": 0.04}), duration_s=20.0)
    baseline, drive = loaded(where, "single-track")
    search = Search(Setup(baseline, drive, CHANNELS))
    search.terms = [term_of(make_dynamics_effect("gyro_delay", delay_s=0.04), baseline)]
    search.fit_until_converged()
    search.may_be_proxy = True

    (alone,) = findings_of(search, search.look(search.offered()))

    assert not alone.may_be_proxy
    search.terms.append(nameless(search)[0].term)
    search.fit_until_converged()
    found = {one.effect: one for one in findings_of(search, search.look(search.offered()))}
    assert found["gyro_delay"].may_be_proxy
    assert found["gyro_delay"].confidence < 0.5 < alone.confidence
