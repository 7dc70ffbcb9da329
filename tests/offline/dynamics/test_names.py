"""Names that are alike, names that are doubtful, and what is said instead."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.offline.dynamics.drives import diagnosed, folder, hidden, loaded
from tpmsd.car.physics.air import AIR_KGPM3
from tpmsd.car.physics.baselines.base import Baseline
from tpmsd.car.physics.baselines.inputs import make_inputs
from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.offline.dynamics.findings import (
    drop_unlikely_suspicions,
    is_improbable,
    promote_strongest_suspicion,
)
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.result import FINDING, SUSPICION, DynamicsFinding, OutputFit
from tpmsd.offline.dynamics.search import CompetingSelection, Search
from tpmsd.offline.dynamics.stages import choose_selection
from tpmsd.offline.dynamics.summary import summary_sentences

FRONT = hidden(cornering_stiffness_error={"front": -0.12, "rear": 0.0})


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A folder for the drives."""
    return str(tmp_path_factory.mktemp("names"))


def test_a_softer_front_axle_and_one_that_gives_way_are_alike(root: str) -> None:
    """C (1 + front) = C / (1 + k C): the rear axle, which may differ as well, makes the name no worse."""
    first = diagnosed(root, FRONT).findings[0]

    names = {first.effect, *first.indistinguishable_from}
    assert names >= {"cornering_stiffness_error", "compliance_steer"}
    assert first.status == FINDING
    assert first.confidence < 0.9


def test_a_stiffer_front_axle_does_not_give_way(root: str) -> None:
    found = diagnosed(root, hidden(cornering_stiffness_error={"front": 0.1, "rear": 0.0})).findings

    assert [one.effect for one in found] == ["cornering_stiffness_error"]
    assert found[0].parameters["front"].value == pytest.approx(0.1, abs=0.01)
    assert found[0].parameters["rear"].value == pytest.approx(0.0, abs=0.01)


def test_a_long_delay_is_looked_for_at_its_size(tmp_path: Path) -> None:
    """Sine steering of 1.5 Hz, 80 ms late: half a radian and more, beyond what the first order reaches."""
    where = folder(tmp_path / "late", hidden(steering_delay={"delay_s": 0.08}), duration_s=40.0)
    baseline, drive = loaded(where, "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat")))
    look = search.look([term for term in search.offered() if term.name == "steering_delay"])
    scores = {(term.jump, term.value("delay_s")): look.score(k) for k, term in enumerate(look.offered)}

    assert scores[(True, 0.05)] > scores[(False, 0.0)] + 10.0
    assert scores[(True, 0.05)] > scores[(True, -0.05)]


def _doubtful(found: DynamicsFinding, **changes: float) -> DynamicsFinding:
    changes = {"confidence": 0.2, **changes}
    return replace(found, status=SUSPICION, **changes)  # type: ignore[arg-type]


def test_a_doubtful_name_becomes_a_cause_without_one(root: str) -> None:
    first = diagnosed(root, FRONT).findings[0]
    (cause,) = promote_strongest_suspicion([_doubtful(first)])

    assert (cause.effect, cause.status, cause.confidence) == ("unknown", FINDING, 0.8)
    assert cause.indistinguishable_from == (first.effect, *first.indistinguishable_from)
    assert cause.where == first.where
    assert cause.parameters == {}


def test_what_predicts_no_better_stays_a_suspicion(root: str) -> None:
    first = diagnosed(root, FRONT).findings[0]
    no_better = _doubtful(first, rms_after=first.rms_before)
    no_gain = _doubtful(first, loglik_gain=-1.0)

    assert promote_strongest_suspicion([no_better, no_gain]) == (no_better, no_gain)


def test_beside_a_finding_a_doubtful_name_stays_a_suspicion(root: str) -> None:
    first = diagnosed(root, FRONT).findings[0]
    other = _doubtful(first)

    assert promote_strongest_suspicion([first, other]) == (first, other)


def test_what_has_odds_of_more_than_twenty_against_it_is_no_suspicion(root: str) -> None:
    first = diagnosed(root, FRONT).findings[0]
    likely, hardly = _doubtful(first), _doubtful(first, confidence=0.04)
    may_be_proxy = replace(first, confidence=0.04)

    assert drop_unlikely_suspicions([likely, hardly, may_be_proxy]) == (likely, may_be_proxy)


@pytest.mark.parametrize(
    ("against", "competitors", "doubtful"),
    [
        (0.9, [], False),
        (1.1, [], True),
        (1.1, [0.0], False),  # the competing one explains as much: one of both it is
        (8.5, [2.0], False),
        (60.0, [4.0], True),  # the competing one is likelier, and no twin
    ],
)
def test_a_name_is_doubtful_where_it_and_its_twins_are_unlikely(
    against: float, competitors: list[float], doubtful: bool
) -> None:
    assert is_improbable(against, competitors) is doubtful


def test_an_output_that_is_predicted_worse_is_not_said_to_fall(root: str) -> None:
    found = diagnosed(root, FRONT)
    fits = {
        "yaw_rate": OutputFit("rad/s", 0.02, 0.01, 0.5, 0.6),
        "accel_lat": OutputFit("m/s2", 0.1, 0.11, 0.5, 0.5),
    }
    said = " ".join(summary_sentences(replace(found, outputs=fits)))
    worse = " ".join(summary_sentences(replace(found, outputs={"accel_lat": fits["accel_lat"]})))

    assert "falls of yaw rate from 0.02 to 0.01 rad/s; it does not fall, of lateral acceleration" in said
    assert "does not fall: it goes of lateral acceleration from 0.1 to 0.11 m/s2" in worse


def _side_force(baseline: Baseline, drag_area_m2: float, rolling: float) -> float:
    car = replace(baseline.car, drag_area_m2=drag_area_m2, rolling_resistance=rolling, drive_front_share=1.0)
    one = np.ones(1)
    inputs = make_inputs(0.0 * one, 0.1 * one, 30.0 * one, 0.0 * one)
    effects = (make_dynamics_effect("large_angles", coefficient=1.0),)
    out = type(baseline)(car, False).read(np.zeros((1, 2)), inputs, effects)
    return float(out["accel_lat"][0]) * car.mass_kg


def test_driven_wheels_carry_drag_and_rolling_resistance(root: str, tmp_path: Path) -> None:
    """Steered and driven, they push to the side with sin(delta) of rho/2 A u^2 + c m g at a steady speed."""
    baseline, _ = loaded(folder(tmp_path / "drag", duration_s=10.0), "single-track")
    more = _side_force(baseline, 0.7, 0.012) - _side_force(baseline, 0.0, 0.0)
    force = 0.5 * AIR_KGPM3 * 0.7 * 30.0**2 + 0.012 * baseline.car.mass_kg * GRAVITY_MPS2

    assert more == pytest.approx(force * np.sin(0.1), rel=1e-9)


def test_a_wind_s_speed_is_known_as_well_as_the_body_s_area(root: str) -> None:
    """Side areas of 3 to 7 m2 instead of 4.5: a fifth of the speed is its standard deviation."""
    span = {"speed_mps": 10.0, "onset_s": 20.0, "duration_s": 15.0}
    (wind,) = diagnosed(root, hidden(side_wind=span)).findings

    speed = wind.parameters["speed_mps"]
    assert wind.effect == "side_wind"
    assert speed.std == pytest.approx(0.2 * speed.value, rel=0.2)


@pytest.mark.parametrize(
    ("nats", "error", "other", "competitor"),
    [(5.0, 0.0, True, True), (5.0, 0.1, False, False), (-5.0, 0.1, False, True)],
)
def test_a_selection_that_predicts_worse_is_no_rival(
    tmp_path: Path, nats: float, error: float, other: bool, competitor: bool
) -> None:
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=10.0), "single-track")
    first = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat")))
    second = first.duplicate()
    first.competitor = second.competitor = CompetingSelection(nats, frozenset())
    second.error = first.error + error

    chosen = choose_selection(first, second, nats)

    assert chosen is (second if other else first)
    assert (chosen.competitor is not None) is competitor
