"""The world of the alarm benchmark: its tyre, its legs and what confounds on them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.campaigns.onboard.alarms.cases import ONSETS, group
from bench.campaigns.onboard.alarms.lives import LEARNING, LEGS, SLIPPERY, kinds, life, slippery
from bench.worlds.magic_tyre import NOMINAL_PA, Tyre, gauge_at
from bench.worlds.surfaces import RESIZED, TAGS, ride
from bench.worlds.trip_cars import POOLS, Car, draw_car
from bench.worlds.trip_road import ROADS, profile
from bench.worlds.trips import Leg, Loss, drive_leg


def radius_mm(force_n: float = 4000.0, gauge: float = 1.0, speed_mps: float = 20.0) -> float:
    return 1e3 * float(Tyre().effective_radius_m(np.array(force_n), np.array(gauge), np.array(speed_mps)))


@pytest.mark.parametrize(
    ("change", "expected_mm"),
    [
        ({"gauge": 0.80}, -1.41),
        ({"gauge": 0.75}, -1.84),
        ({"gauge": 0.70}, -2.31),
        ({"force_n": 4500.0}, -0.25),
    ],
)
def test_the_tyre_has_the_published_sizes(change: dict[str, float], expected_mm: float) -> None:
    """205/60R15 at 4 kN, 220 kPa and 20 m/s: what pressure and load do to its effective radius, in mm."""
    assert expected_mm == pytest.approx(radius_mm(**change) - radius_mm(), abs=0.015)


def test_the_tyre_grows_with_speed_and_warmth_as_published() -> None:
    """10 to 36 m/s: about 1.1 mm; 20 K: 0.56 mm, by the gas law."""
    warm = float(gauge_at(np.array(313.0), 293.0))

    assert 1.10 == pytest.approx(radius_mm(speed_mps=36.0) - radius_mm(speed_mps=10.0), abs=0.08)
    assert 0.56 == pytest.approx(radius_mm(gauge=warm) - radius_mm(), abs=0.015)


def test_the_gas_law_holds_absolute_pressure_over_temperature() -> None:
    """220 kPa over an atmosphere, warmed from 293 K to 313 K: (321.3 kPa x 313 / 293) absolute."""
    expected_pa = 321.3e3 * 313.0 / 293.0 - 101.3e3

    assert expected_pa == pytest.approx(NOMINAL_PA * float(gauge_at(np.array(313.0), 293.0)))


@pytest.fixture(scope="module")
def car() -> Car:
    """A car with gyro and counts."""
    drawn = draw_car(np.random.default_rng(4), "development", 4)
    return replace(drawn, spec=replace(drawn.spec, wheel_signal="counts", radius_drift=0.0, rough=0.0))


def test_a_loss_of_air_acts_on_its_wheel_alone_and_from_its_onset(car: Car) -> None:
    """-20 % within 10 s from 60 s on: nothing before, then 1 to 2 mm on that wheel."""
    driven = drive_leg(car, Leg(seed=3, road="rural", duration_s=120.0, losses=(Loss(2, 0.2, 60.0, 10.0),)))
    before, after = driven.lost_m[: 59 * 50], driven.lost_m[71 * 50 :]

    assert 0.0 == np.abs(before).max()
    assert 0.0 == np.abs(after[:, [0, 1, 3]]).max()
    assert 0.7e-3 < after[:, 2].min() < after[:, 2].max() < 2.5e-3


def test_wheels_turn_by_the_distance_over_their_radius(car: Car) -> None:
    """Over two minutes, a wheel without drive has turned by its hub's way over its radius, to 0.05 %."""
    driven = drive_leg(car, Leg(seed=5, road="track", duration_s=120.0))
    free = 2 if car.spec.driven == "front" else 0
    shown = driven.drive.shown_rad
    turned = float(shown[-1, free] - shown[0, free])
    distance = float(driven.distance_m[-1])

    assert turned == pytest.approx(distance / float(driven.radius_m[:, free].mean()), rel=2e-3)
    assert distance == pytest.approx(float(np.abs(driven.drive.speed).sum()) * 0.02, rel=1e-3)


def test_the_same_seed_drives_the_same_leg(car: Car) -> None:
    """Reproducible to the last bit; another seed is another leg."""
    first, again, other = (
        drive_leg(car, Leg(seed=seed, road="city", duration_s=60.0)).drive for seed in (3, 3, 4)
    )

    assert np.array_equal(first.shown_rad, again.shown_rad)
    assert np.array_equal(first.fix_east, again.fix_east)
    assert not np.array_equal(first.shown_rad, other.shown_rad)


@pytest.mark.parametrize("road", sorted(ROADS))
def test_each_road_is_driven_within_its_speeds_and_a_tyres_grip(road: str) -> None:
    """Nobody drives faster than the road's fastest leg, or beyond 6.1 m/s2 in a bend."""
    driven = profile(road, 600.0, np.random.default_rng(2))
    lateral = np.abs(driven.speed**2 * driven.bend)

    assert driven.speed.max() <= ROADS[road].legs_mps[1] + 0.5
    assert lateral.max() < 6.1
    assert 30_000 == len(driven.speed) == len(driven.slope)


@pytest.mark.parametrize("tag", sorted(TAGS))
def test_each_confounder_makes_a_drive_of_sound_numbers(tag: str, car: Car) -> None:
    """Angles that only rise, but for roughness and late frames; fixes in order; no NaN but the course."""
    driven = drive_leg(car, Leg(seed=8, road="rural", duration_s=240.0, tags=(tag,)))
    drive = driven.drive

    assert np.isfinite(drive.shown_rad).all()
    assert np.isfinite(driven.radius_m).all()
    assert (np.diff(drive.fix_true_s) > 0.0).all()
    assert (np.diff(drive.shown_rad[::50], axis=0) > -0.05).all()


def test_on_a_ferry_the_position_moves_and_the_wheels_stand() -> None:
    """The wheels turn with the road before and after alone; a towed car's front wheels stand."""
    for tag, standing in (("ferry", 4), ("towing", 2)):
        whole, surface = ride("rural", 300.0, (tag,), np.random.default_rng(3))
        carried = ~surface.turns.all(axis=1)

        assert standing == int((surface.turns[carried][0] == 0.0).sum())
        assert np.abs(whole.speed[carried]).max() > 2.0
        assert 0.0 == pytest.approx(float(np.abs(whole.speed[np.flatnonzero(carried)[0] - 1])), abs=0.3)


def test_ice_spins_and_locks_wheels_one_by_one() -> None:
    """Slip of tens of per cent on some wheels in some patches, none between them."""
    _, surface = ride("rural", 900.0, ("ice",), np.random.default_rng(5))

    assert np.abs(surface.spin).max() > 0.2
    assert (surface.spin == 0.0).mean() > 0.8


def test_cases_cover_the_regulations() -> None:
    """Over a dozen cars each standard meets each onset that it has, and each single wheel loses air."""
    cases = [case for seed in range(12) for case in group("development", seed).cases]
    standards = {case.standard for case in cases}

    assert {"r141-puncture", "r141-diffusion", "fmvss-1", "fmvss-2", "fmvss-3", "fmvss-4"} == standards
    assert {(0,), (1,), (2,), (3,)} <= {case.wheels for case in cases if case.standard == "r141-puncture"}
    for standard in standards:
        onsets = {case.onset for case in cases if case.standard == standard}
        assert (set(ONSETS[1:]) if standard == "r141-diffusion" else set(ONSETS)) == onsets
    assert {1.0, 5.0, 10.0} == {group("development", seed, 1).car.spec.receiver_hz for seed in range(12)}
    assert len(cases) == len({case.name for case in cases})


def test_lives_meet_every_confounder() -> None:
    """Three cars' lives hold them all; the first legs of each are for learning and hold none."""
    lives = [life("development", seed) for seed in range(3)]

    assert set(TAGS) == {tag for each in lives for leg in each.legs for tag in leg.tags}
    for each in lives:
        assert LEGS == len(each.legs)
        assert {("plain",)} == {leg.tags for leg in each.legs[:LEARNING]}


def test_each_kind_of_confounder_has_a_leg_of_its_own() -> None:
    """After the legs of learning, one with each tag alone; the wheels of another size are."""
    legs = kinds("development", 1).legs

    assert [(tag,) for tag in TAGS] == [leg.tags for leg in legs[LEARNING:]]
    assert life("development", 1).legs[:LEARNING] == legs[:LEARNING]
    assert {*RESIZED} == {leg.tags[0] for leg in legs if any(leg.resized_m)}
    assert legs == kinds("development", 1).legs


def test_a_slippery_life_has_ice_snow_or_gravel_on_each_leg() -> None:
    """The car and its learning are those of its life, no wheel is of another size, and all kinds occur."""
    legs = slippery("development", 5).legs

    assert life("development", 5).legs[:LEARNING] == legs[:LEARNING]
    assert all({"ice", "slip", "gravel"} & set(leg.tags) for leg in legs[LEARNING:])
    assert set(SLIPPERY) == {leg.tags for leg in legs[LEARNING:]}
    assert not any(any(leg.resized_m) for leg in legs)
    assert legs == slippery("development", 5).legs


def test_the_held_out_half_has_other_cars_and_roads() -> None:
    """No kind of car, no road and no number of teeth is in both pools."""
    seen: dict[str, tuple[set[str], set[str], set[float]]] = {}
    for pool in POOLS:
        groups = [group(pool, seed) for seed in range(12)]
        roads = {leg.road for each in groups for leg in (*each.healthy, *(case.leg for case in each.cases))}
        seen[pool] = ({g.car.kind for g in groups}, roads, {g.car.spec.teeth for g in groups})
    first, second = (seen[pool] for pool in POOLS)

    for ours, theirs in zip(first, second, strict=True):
        assert not ours & theirs
    assert math.isfinite(sum(second[2]))
