"""Closed forms for terms without a name: found, and written as a file that the catalogue takes."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from tests.offline.dynamics.drives import folder, hidden, loaded
from tpmsd.car.physics.dynamics_effects.time_spline import DynamicsUnknown
from tpmsd.car.physics.own_dynamics import checked_effect
from tpmsd.car.physics.own_effects import dynamics_classes_of, module_of_file
from tpmsd.foundation.schemas import schema_of
from tpmsd.offline.dynamics.document import dynamics_document
from tpmsd.offline.dynamics.located import LocatedTerm, fit_located_term
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.proposals import dynamics_effect_file, proposals
from tpmsd.offline.dynamics.result import ClosedForm, DynamicsDiagnosis
from tpmsd.offline.dynamics.search import Search
from tpmsd.offline.dynamics.terms import spline_term

FORM = schema_of("tpmsd.diagnosis/2")["properties"]["proposals"]


def test_a_moment_that_grows_with_speed_and_turn_is_described(tmp_path: Path) -> None:
    """The truth is -4e-4 u^2 sign(r) min(20 |r|, 1), close to -0.008 u^2 r where the car turns gently; the
    lateral acceleration u r is part of the proposed form, and its coefficient is negative."""
    where = folder(tmp_path / "d", hidden(beyond={"moment_per_speed2": -4e-4}), duration_s=60.0)
    baseline, drive = loaded(where, "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat")))
    knots = (-0.3, -0.1, 0.0, 0.1, 0.3)
    flat = DynamicsUnknown(knots=knots, heights=(0.0,) * 5, on="moment", over="yaw_rate")
    assert search.try_terms([fit_located_term(search, LocatedTerm(spline_term(flat, 0.6), 0.0))])
    every = proposals(search)
    best = every[0]
    made = DynamicsDiagnosis("mismatch", "", "single-track", False, (), 60.0, proposals=every)

    jsonschema.validate(json.loads(json.dumps(dynamics_document(made, None)["proposals"])), FORM)
    assert best.gain > best.heldout_gain
    assert best.on == "moment"
    assert set(best.covariates) & {"accel_lat", "yaw_rate", "speed"}
    assert best.heldout_gain > 50.0
    grid = {name: np.array([0.1, -0.1]) for name in best.covariates} | {"speed": np.array([20.0, 20.0])}
    value = eval(best.formula, {"np": np, **grid})
    assert value[0] * best.coefficient < 0.0


def test_where_all_has_a_name_there_is_nothing_to_propose(tmp_path: Path) -> None:
    """No term, no proposal."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=20.0), "single-track")

    assert proposals(Search(Setup(baseline, drive, ("yaw_rate",)))) == ()


@pytest.mark.parametrize("on", ["moment", "force_y", "force_x", "force_front", "force_rear", "yaw_rate"])
def test_the_file_of_a_proposal_is_an_effect(tmp_path: Path, on: str) -> None:
    """It is read as a module, passes the trial of an own effect and adds what the formula says."""
    proposal = ClosedForm(
        "made_up", "speed * np.abs(steering)", ("speed", "steering"), on, 0.3, 0.01, "m/s.rad", 9.5, 9.0, "x"
    )
    name, text = dynamics_effect_file(proposal, 'a """drive')
    path = tmp_path / f"{name}.py"
    path.write_text(text)
    (effect,) = dynamics_classes_of(module_of_file(path))

    assert checked_effect(effect, str(path)).name == "proposed_made_up"
    assert effect.numbers()[0].typical == 0.3
