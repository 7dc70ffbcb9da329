"""Names that compete for one finding, each fitted in its place."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.offline.dynamics.drives import diagnosed, folder, hidden, loaded
from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.offline.dynamics import competitors
from tpmsd.offline.dynamics.competitors import (
    Compared,
    choose_best_variants,
    exchange_for_likelier,
    fit_competitors,
    merge_confounded_terms,
)
from tpmsd.offline.dynamics.findings import findings_of
from tpmsd.offline.dynamics.path import Setup, smoothed
from tpmsd.offline.dynamics.search import CompetingSelection, Search
from tpmsd.offline.dynamics.terms import term_of


def test_a_soft_axle_and_wheels_that_give_way_are_one_to_a_linear_car(tmp_path: Path) -> None:
    """C / (1 + k C) is a softer axle: whichever is named lists the other, and both share the probability."""
    found = diagnosed(str(tmp_path), hidden(compliance_steer={"coefficient": 0.0025}))

    assert len(found.findings) == 1
    one = found.findings[0]
    assert {"compliance_steer", "cornering_stiffness_error"} <= {one.effect, *one.indistinguishable_from}
    assert 0.1 < one.confidence < 0.9


def test_front_wheels_that_turn_by_the_acceleration_have_two_names(tmp_path: Path) -> None:
    """Whether they turn by roll or give way, the car moves the same: whichever is named lists the other."""
    found = diagnosed(str(tmp_path), hidden(roll_steer={"front": 0.0015, "instant": 1.0}))

    assert len(found.findings) == 1
    one = found.findings[0]
    assert {"compliance_steer", "roll_steer"} <= {one.effect, *one.indistinguishable_from}
    assert 0.1 < one.confidence < 0.9


def test_front_wheels_that_steer_by_roll_may_push_by_camber(tmp_path: Path) -> None:
    """To a linear car both are a front side force in proportion to a_y, braking or not."""
    found = diagnosed(str(tmp_path), hidden(roll_steer={"front": 0.0012}))

    (one,) = found.findings
    assert {"camber_thrust", "roll_steer"} <= {one.effect, *one.indistinguishable_from}
    assert 0.1 < one.confidence < 0.9


def test_a_name_is_as_likely_as_the_selections_that_hold_it(tmp_path: Path) -> None:
    """A selection in which a name became needless beside another term's competitor counts against it."""
    where = folder(
        tmp_path / "d", hidden(mass_error={"relative": 0.1}, yaw_rate_scale={"scale": 1.02}), duration_s=20.0
    )
    baseline, drive = loaded(where, "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat")))
    search.record_stage()
    search.terms = [
        term_of(make_dynamics_effect(name, **values), baseline)
        for name, values in {"mass_error": {"relative": 0.1}, "yaw_rate_scale": {"scale": 1.02}}.items()
    ]
    search.fit_until_converged()
    look = search.look(search.offered())
    both, alone = frozenset({"mass_error", "roll_steer"}), frozenset({"cornering_stiffness_error"})
    nats = {"mass_error": {"cornering_stiffness_error": 1.0}, "yaw_rate_scale": {"roll_steer": 2.0}}
    keys = {("mass_error", "cornering_stiffness_error"): alone, ("yaw_rate_scale", "roll_steer"): both}
    elsewhere = Compared(search, look, nats, keys).selections_without()

    assert elsewhere == {"mass_error": (), "yaw_rate_scale": (CompetingSelection(1.0, alone),)}
    before, after = (
        next(one for one in findings_of(search, look, None, each) if one.effect == "yaw_rate_scale")
        for each in (None, elsewhere)
    )
    assert 1.0 / after.confidence - 1.0 / before.confidence == pytest.approx(math.e)
    assert "cornering_stiffness_error" in after.indistinguishable_from


def test_a_nuisance_that_a_competitor_is_offered_is_offered_to_the_selection_too(tmp_path: Path) -> None:
    """Roll lag explains a late gyro in part: gained by a competitor alone it would outweigh the true name."""
    hides = hidden(roll_steer={"front": 0.0015, "instant": 1.0}, gyro_delay={"delay_s": 0.02})
    baseline, drive = loaded(folder(tmp_path / "d", hides, duration_s=200.0), "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat")))
    search.record_stage()
    search.terms = [term_of(make_dynamics_effect("roll_steer", front=0.0015, instant=1.0), baseline)]
    search.fit_until_converged()
    search.record_stage()

    nats, _, _ = fit_competitors(search, search.look(search.offered()))

    assert "compliance_steer" in nats["roll_steer"]
    assert all(value < 3.0 for value in nats["roll_steer"].values())


def test_a_name_that_is_plainly_likelier_takes_the_place_of_the_one_selected(tmp_path: Path) -> None:
    """A late gyro under the name of late steering: the delay of the gyro is fitted in its place and stays."""
    where = folder(tmp_path / "d", hidden(gyro_delay={"delay_s": 0.04}), duration_s=40.0)
    baseline, drive = loaded(where, "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat")))
    search.record_stage()
    search.terms = [term_of(make_dynamics_effect("steering_delay", delay_s=0.02), baseline)]
    search.fit_until_converged()
    search.record_stage()

    likeliest = exchange_for_likelier(search)

    assert [term.name for term in likeliest.search.named] == ["gyro_delay"]
    assert likeliest.search.terms[0].value("delay_s") == pytest.approx(0.04, abs=0.004)
    assert [stage.terms[0].name for stage in likeliest.search.stages[1:]] == ["steering_delay", "gyro_delay"]
    assert all(nats < 3.0 for nats in likeliest.competitors.get("gyro_delay", {}).values())


def test_one_name_takes_the_place_of_two_that_are_the_same(tmp_path: Path) -> None:
    """Axles that steer by a_y change force and moment in proportion to it, as mass and a moment do together:
    the name that needs no other stays alone."""
    steered = {"coefficient": 0.0006, "front": 0.0009, "instant": 1.0}
    where = folder(tmp_path / "d", hidden(roll_steer=steered), duration_s=20.0)
    baseline, drive = loaded(where, "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat")))
    search.record_stage()
    two = {"yaw_moment": {"lateral_m": -0.1}, "mass_error": {"relative": 0.05}}
    search.terms = [term_of(make_dynamics_effect(name, **value), baseline) for name, value in two.items()]
    search.fit_until_converged()
    search.record_stage()

    likeliest = exchange_for_likelier(search).search

    assert [term.name for term in likeliest.named] == ["roll_steer"]
    assert likeliest.named[0].effect.values() == pytest.approx({**steered, "directed": 1.0}, abs=1e-4)


def test_one_of_two_confounded_names_does_what_both_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A moment by the side force took most of roll steer that follows at once, and the lag of the rest is one
    that roll has: no step leads from there to roll steer alone."""
    steered = {"coefficient": 0.0006, "front": 0.0009, "instant": 1.0}
    where = folder(tmp_path / "d", hidden(roll_steer=steered), duration_s=40.0)
    baseline, drive = loaded(where, "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat")))
    search.record_stage()
    both = {
        "yaw_moment": {"lateral_m": -0.13},
        "roll_steer": {"coefficient": 1e-4, "front": 1e-4},
        "roll_lag": {"delay_s": 0.1, "square_s2": 0.01},
    }
    search.terms = [term_of(make_dynamics_effect(name, **value), baseline) for name, value in both.items()]
    search.at = smoothed(search.setup, search.theta, search._adapt_to_states(search.at.path), search.noise)
    search.fit_until_converged()
    search.error = search.prediction_error()

    likeliest = merge_confounded_terms(search)

    assert [term.name for term in likeliest.named] == ["roll_steer"]
    assert likeliest.named[0].values() == pytest.approx([0.0006, 0.0009], abs=1e-4)
    assert likeliest.stages[-1].terms[0] is likeliest.terms[0]
    assert merge_confounded_terms(likeliest) is likeliest

    # Where no single exchange is likelier, this is tried.
    monkeypatch.setattr(competitors, "_likelier_selection", lambda *_: None)
    assert [term.name for term in exchange_for_likelier(search).search.named] == ["roll_steer"]


def test_an_effect_acts_in_its_likeliest_variant(tmp_path: Path) -> None:
    """Axles that steer by all of a_y were taken for axles that steer by u r when the first step chose."""
    steered = {"coefficient": 0.0006, "front": 0.0009, "instant": 1.0}
    where = folder(tmp_path / "d", hidden(roll_steer=steered), duration_s=20.0)
    baseline, drive = loaded(where, "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat")))
    search.terms = [term_of(make_dynamics_effect("roll_steer", coefficient=0.0006, front=0.0009), baseline)]
    search.fit_until_converged()

    best = choose_best_variants(search)

    assert best.terms[0].effect.values() == pytest.approx({**steered, "directed": 1.0}, abs=1e-4)
    assert best.stages[-1].terms[0] is best.terms[0]
    assert choose_best_variants(best) is best
