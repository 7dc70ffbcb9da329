"""Closed forms are proposed for physics that nobody listed, and found by name on a fresh drive."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.worlds.course import Course
from bench.worlds.instruments import observe
from bench.worlds.kinematic import Spec, course
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.assessment.result import Proposal, RollingDiagnosis
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.proposal.effect_file import effect_file
from tpmsd.offline.diagnosis.proposal.expressions import Expression, expressions, shaped_expressions
from tpmsd.offline.diagnosis.proposal.search import Sums, fitted_proposal

REPO = Path(__file__).resolve().parents[3]
Law = Callable[[Course], np.ndarray]
"""(n, 4) relative surplus of turning."""


def law_of(size: Callable[[Course], np.ndarray], *wheels: float) -> Law:
    """A law of the motion on some wheels with signs."""
    return lambda trip: size(trip)[:, None] * np.array(wheels)


LAWS: dict[str, tuple[Law, set[str]]] = {
    "product": (
        law_of(lambda trip: 6e-5 * trip.speed * trip.force, 0.0, 0.0, 1.0, 0.0),
        {"speed", "accel_long"},
    ),
    "step": (
        law_of(lambda trip: 2e-3 / (1.0 + np.exp(-(trip.speed - 16.0))), 0.0, 0.0, 1.0, 1.0),
        {"speed"},
    ),
    "threshold": (
        law_of(lambda trip: 3e-3 * np.where(trip.a_lat > 1.0, trip.a_lat - 1.0, 0.0), 0.0, 1.0, 0.0, 0.0),
        {"accel_lat"},
    ),
}

FORMS = {"product": "speed * ", "step": "np.tanh((speed - ", "threshold": "np.maximum(accel_lat - "}
"""Part of the formula that is wanted; a logistic step is a tanh of half the argument."""


def diagnosed(law: Law, seed: int, propose: bool) -> RollingDiagnosis:
    """A drive of the independent world in which the law acts."""
    spec = Spec(duration_s=300.0, road="mixed", driven="front", stops=True)
    rng = np.random.default_rng(seed)
    trip = course(spec, rng)
    return diagnose([recording_of(observe(replace(trip, spin=law(trip)), spec, rng, seed))], propose=propose)


FRESH = """
import sys
import tpmsd.car.physics.effects as effects
effects.__path__.append(sys.argv[1])
from tests.offline.diagnosis.test_proposal import LAWS, diagnosed
print(*(one.effect for one in diagnosed(LAWS[sys.argv[2]][0], 12, False).findings))
"""


@pytest.mark.parametrize("kind", list(LAWS))
def test_what_nobody_listed_is_proposed_and_then_found_by_name(kind: str, tmp_path: Path) -> None:
    """The right covariates come first, and the file that was dropped in is named first on a fresh drive."""
    law, covariates = LAWS[kind]
    found = diagnosed(law, 11, True)

    assert found.proposals
    best = found.proposals[0]
    assert covariates == set(best.covariates)
    assert best.heldout_gain > 10.0
    assert FORMS[kind] in best.formula
    name, text = effect_file(best, "the drive")
    (tmp_path / f"{name}.py").write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", FRESH, str(tmp_path), kind],
        cwd=REPO,
        env={**os.environ, "PYTHONPATH": str(REPO)},
        capture_output=True,
        text=True,
        check=False,
    )

    assert 0 == done.returncode, done.stderr
    assert name == done.stdout.split()[0]


def test_no_name_of_a_drive_can_end_the_text_of_a_file() -> None:
    """Quotes and line ends in a folder's name stay within the docstring."""
    law = Proposal("made_up", "speed", ("speed",), "fl", 1e-5, 1e-6, "m/s", 9.5, 9.0)

    ast.parse(effect_file(law, 'a """drive\n\\')[1])


def test_nothing_is_proposed_where_nothing_is_unnamed() -> None:
    """A drive of the rolling model has no proposal."""
    assert () == diagnosed(lambda trip: np.zeros((len(trip.time_s), 4)), 11, True).proposals


def test_a_form_that_fits_brings_half_of_the_data_squared() -> None:
    """Twice the trial column in each of five folds, beside a column that has no part in it."""
    known = np.tile(np.diag([4.0 * 30.0, 7.0]), (5, 1, 1))
    cross = np.tile(np.array([[2.0 * 30.0], [0.0]]), (5, 1, 1))
    judged_form = fitted_proposal(
        Sums(known, cross, np.full((5, 1), 30.0)), 0, Expression("linear", ("speed",)), "rl"
    )

    assert pytest.approx(2.0, rel=1e-5) == judged_form.coefficient
    assert pytest.approx(150.0**-0.5, rel=1e-5) == judged_form.std
    assert pytest.approx((300.0, 300.0), rel=1e-5) == (judged_form.gain, judged_form.heldout_gain)


def test_all_forms_of_two_covariates() -> None:
    """Six of each alone, three of the pair; none over time."""
    forms = expressions(["speed", "time", "accel_lat"])

    assert 15 == len(forms) == len({form.name for form in forms})
    values = {"speed": np.array([2.0, 3.0]), "accel_lat": np.array([-1.0, 2.0])}
    product = Expression("times_size_of", ("speed", "accel_lat"))
    assert [2.0, 6.0] == product.values(values).tolist()
    assert "speed * np.abs(accel_lat)" == product.formula


def test_a_file_acts_on_its_reading(tmp_path: Path) -> None:
    """A proposal on the gyro is a yaw rate's error in the catalogue that is read with it."""
    proposal = Proposal(
        "yaw_rate_squared", "yaw_rate**2", ("yaw_rate",), "yaw_rate", 0.05, 1e-3, "rad/s", 90.0, 80.0
    )
    name, text = effect_file(proposal, "the drive")
    module = tmp_path / f"{name}.py"
    module.write_text(text)
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys; import tpmsd.car.physics.effects as e; e.__path__.append(sys.argv[1])\n"
            "from tpmsd.car.physics.catalogue import make_effect\n"
            "from tests.car.physics.motions import car, steady\n"
            "made = make_effect(sys.argv[2], coefficient=0.05)\n"
            "print(made.yaw_rate_error_radps(steady(20.0, 0.1), car())[0].round(9))",
            str(tmp_path),
            name,
        ],
        cwd=REPO,
        capture_output=True,
        text=True,
        check=True,
    )

    assert 0.0005 == float(done.stdout)


def test_forms_with_numbers_of_their_own_are_what_their_formula_says() -> None:
    """Steps, saturation, thresholds and dead zones; of a covariate of one sign only steps and thresholds."""
    values = np.linspace(-3.0, 5.0, 81)
    forms = shaped_expressions("accel_lat", values)

    assert {"step", "above", "saturated", "dead_zone"} == {form.form for form in forms}
    assert {"step", "above"} == {form.form for form in shaped_expressions("speed", values + 10.0)}
    assert [] == shaped_expressions("time", values) == shaped_expressions("speed", np.full(9, 20.0))
    for form in forms:
        reported = eval(form.formula, {"np": np, "accel_lat": values})
        assert reported == pytest.approx(form.values({"accel_lat": values}))
    assert {"1", "m/s2"} == {form.unit for form in forms}
