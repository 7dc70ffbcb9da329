"""One suite over all rows of the table: what every filter promises, whatever it is made of.

Another row is under it as soon as it stands in `tpmsd.onboard.estimators.table`.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.exact import exact
from tests.onboard.estimators.world import METHODS, VEHICLE, Drive, World, estimator, run
from tpmsd.car.config.model import FilterConfig, GnssConfig
from tpmsd.onboard.estimators.bank.marginal import MarginalBelief
from tpmsd.onboard.estimators.bank.mixture import MixtureBelief
from tpmsd.onboard.estimators.base import RadiusEstimate, unsound_reason
from tpmsd.onboard.estimators.build import build_filter
from tpmsd.onboard.estimators.published.gaussian import GaussianBelief
from tpmsd.onboard.estimators.published.samples import SampledBelief
from tpmsd.onboard.estimators.radius_filter import RadiusFilter
from tpmsd.onboard.estimators.table import ALIASES
from tpmsd.onboard.timeline.tick import Tick

EACH = pytest.mark.parametrize("method", METHODS)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return World(duration_s=40.0, steering=True).drive()


def bits(estimates: list[RadiusEstimate]) -> object:
    return exact(estimates)


@EACH
@pytest.mark.parametrize("front", [True, False])
def test_shapes_and_nan(method: str, front: bool, drive: Drive) -> None:
    """Arrays of four; what is not estimated is NaN and the rest is finite; covariances are symmetric and
    positive."""
    for said in run(estimator(method, drive.world, front=front), drive.ticks)[::20]:
        assert (4,) == said.deviation_m.shape == said.noise_std_m.shape
        assert (4, 4) == said.covariance_m2.shape
        known = np.array([front, front, True, True])
        assert np.array_equal(np.isfinite(said.deviation_m), known)
        assert np.array_equal(np.isfinite(said.covariance_m2), np.outer(known, known))
        inside = said.covariance_m2[np.ix_(known, known)]
        assert inside == pytest.approx(inside.T, rel=1e-9, abs=1e-18)
        assert np.linalg.eigvalsh(inside).min() > 0.0
        assert np.all(said.noise_std_m[known] > 0.0)
        assert said.effective_particles >= 1.0 - 1e-9
        if deterministic(method):
            assert math.isnan(said.ancestors)
            assert math.isnan(said.between_std_m)
        else:
            assert said.ancestors >= 1.0
            assert said.between_std_m >= 0.0


@EACH
def test_the_same_seed_gives_the_same_bits(method: str, drive: Drive) -> None:
    """Two filters of one seed agree to the bit."""
    a, b = (run(estimator(method, drive.world, seed=3), drive.ticks[:200]) for _ in range(2))
    assert bits(a) == bits(b)


@EACH
def test_a_tick_is_not_changed(method: str, drive: Drive) -> None:
    """Inputs may be read-only."""
    ticks = []
    for tick in drive.ticks[:150]:
        rotation, std = tick.rotation_rad.copy(), tick.rotation_std_rad.copy()
        rotation.setflags(write=False)
        std.setflags(write=False)
        ticks.append(replace(tick, rotation_rad=rotation, rotation_std_rad=std))
    assert bits(run(estimator(method, drive.world), ticks)) == bits(
        run(estimator(method, drive.world), drive.ticks[:150])
    )


@EACH
def test_an_estimate_does_not_change_later(method: str, drive: Drive) -> None:
    """What was handed out stays what it was when the filter goes on."""
    filter_ = estimator(method, drive.world)
    first = run(filter_, drive.ticks[:100])
    before = bits(first)
    run(filter_, drive.ticks[100:200])
    assert before == bits(first)


@EACH
def test_left_and_right_are_equal(method: str, drive: Drive) -> None:
    """The mirrored drive has the mirrored radii: to a thousandth of a standard deviation where
    nothing is drawn, else left against right to a millimetre, as other seeds differ."""
    last = run(estimator(method, drive.world), drive.ticks)[-1]
    other = run(estimator(method, drive.world), [mirrored(t) for t in drive.ticks])[-1]
    swapped = other.deviation_m[[1, 0, 3, 2]]
    if deterministic(method):
        # Left is used before right, and robust weights make that a difference in the third digit.
        assert np.all(np.abs(swapped - last.deviation_m) < 1e-3 * np.sqrt(np.diag(last.covariance_m2)))
        assert np.diag(other.covariance_m2)[[1, 0, 3, 2]] == pytest.approx(
            np.diag(last.covariance_m2), rel=1e-2
        )
    else:
        apart = [d[2] - d[3] for d in (swapped, last.deviation_m)]
        assert apart[0] == pytest.approx(apart[1], abs=1e-3)


def deterministic(method: str) -> bool:
    belief = estimator(method, World(), front=False).belief
    return isinstance(belief, GaussianBelief | MixtureBelief) and not isinstance(belief, MarginalBelief)


def mirrored(tick: Tick) -> Tick:
    """Left for right: the world seen in a mirror along the east axis."""
    swap = [1, 0, 3, 2]
    fixes = tuple(replace(f, north_m=-f.north_m, heading_rad=-f.heading_rad) for f in tick.fixes)
    return replace(
        tick,
        rotation_rad=tick.rotation_rad[swap],
        rotation_std_rad=tick.rotation_std_rad[swap],
        yaw_rate_radps=-tick.yaw_rate_radps,
        steering_wheel_angle_rad=-tick.steering_wheel_angle_rad,
        fixes=fixes,
    )


@EACH
def test_a_place_and_a_direction_are_nothing_special(method: str, drive: Drive) -> None:
    """The same drive elsewhere and rotated has the same radii where nothing is drawn."""
    if not deterministic(method):
        pytest.skip("draws depend on the numbers to rounding, and particles amplify it")
    angle, shift = 0.7, (3000.0, -800.0)
    cos, sin = math.cos(angle), math.sin(angle)
    moved = [
        replace(
            t,
            fixes=tuple(
                replace(
                    f,
                    east_m=cos * f.east_m - sin * f.north_m + shift[0],
                    north_m=sin * f.east_m + cos * f.north_m + shift[1],
                    heading_rad=f.heading_rad + angle,
                )
                for f in t.fixes
            ),
        )
        for t in drive.ticks
    ]
    a, b = (run(estimator(method, drive.world), t)[-1] for t in (drive.ticks, moved))
    # Positions are used axis by axis with robust weights, so a rotation is not exact.
    std = np.sqrt(np.diag(a.covariance_m2))
    assert np.all(np.abs(a.deviation_m - b.deviation_m) < 0.2 * std)


@EACH
def test_missing_channels_are_left_out(method: str, drive: Drive) -> None:
    """Without gyro, steering, course and Doppler speed the radii stay finite and positions still count."""
    bare = [
        replace(
            t,
            yaw_rate_radps=math.nan,
            steering_wheel_angle_rad=math.nan,
            fixes=tuple(replace(f, speed_mps=math.nan, heading_rad=math.nan, up_m=math.nan) for f in t.fixes),
        )
        for t in drive.ticks
    ]
    filter_ = estimator(method, drive.world)
    last = run(filter_, bare)[-1]
    assert np.all(np.isfinite(last.deviation_m))
    assert math.isfinite(last.east_m)
    assert filter_.counts["fixes"] > 20


@EACH
def test_a_snapshot_survives_its_own_restore(method: str, drive: Drive) -> None:
    """Restored into a new filter, the JSON of a snapshot gives the same mean radii; a snapshot changes
    nothing."""
    filter_ = estimator(method, drive.world, particles=4000)
    run(filter_, drive.ticks[:150])
    saved = json.loads(json.dumps(filter_.snapshot(), allow_nan=False))
    assert saved == json.loads(json.dumps(filter_.snapshot(), allow_nan=False))
    again = estimator(method, drive.world, particles=4000)
    again.restore(saved)
    after = again.snapshot()
    std = np.sqrt(np.diag(saved["covariance_m2"]))
    drawn = 0.0 if deterministic(method) else 5.0 / math.sqrt(4000)
    assert np.all(np.abs(np.array(after["mean_m"]) - saved["mean_m"]) <= drawn * std + 1e-12)
    assert saved["informative_s"] == after["informative_s"]


HUGE = int("9" * 400)
NONSENSE: list[dict[str, Any]] = [
    {"order": [2, 3]},
    {"nominal_m": [0.316, 0.316, 0.316, 0.3]},
    {"nominal_m": []},
    {"nominal_m": "wide"},
    {"mean_m": [0.0, 0.0]},
    {"mean_m": [0.0, 0.0, 0.0, 0.1]},
    {"mean_m": [0.0, 0.0, 0.0, math.nan]},
    {"mean_m": [0.0, 0.0, 0.0, HUGE]},
    {"mean_m": [[0.0], [0.0, 1.0], 0.0, 0.0]},
    {"mean_m": "soft"},
    {"mean_m": None},
    {"covariance_m2": [[0.0]]},
    {"covariance_m2": (-np.eye(4)).tolist()},
    {"covariance_m2": np.full((4, 4), math.inf).tolist()},
    {"covariance_m2": (1e308 * np.eye(4)).tolist()},
    {"covariance_m2": np.triu(np.full((4, 4), 1e-8)).tolist()},
    {"informative_s": None},
    {"informative_s": "long"},
    {"informative_s": HUGE},
    {"informative_s": math.nan},
]
OF_NUISANCES: list[dict[str, Any]] = [
    {"nuisance": [0.0]},
    {"nuisance": [1e300] * 8},
    {"nuisance_covariance": (1e308 * np.eye(8)).tolist()},
    {"nuisance_covariance": [[HUGE] * 8] * 8},
    {"nuisance_covariance": (-np.eye(8)).tolist()},
]
OWN: dict[type, list[dict[str, Any]]] = {
    MixtureBelief: OF_NUISANCES,
    MarginalBelief: OF_NUISANCES,
    SampledBelief: [{"noise_m2": [1e-6]}, {"noise_m2": [0.0, 1e-6]}, {"noise_m2": [HUGE, 1e-6]}],
    GaussianBelief: [{"noise_m2": [-1.0, 1e-6]}, {"noise_m2": None}],
}


def rear_of(filter_: RadiusFilter) -> object:
    return getattr(filter_.belief, "rear", filter_.belief)


@EACH
def test_nonsense_is_rejected(method: str, drive: Drive) -> None:
    """A snapshot of another car, of another shape, not finite or absurd raises ValueError and nothing else,
    and changes nothing; so does one that lacks a key."""
    filter_ = estimator(method, drive.world)
    run(filter_, drive.ticks[:60])
    saved = json.loads(json.dumps(filter_.snapshot()))
    before = repr(filter_.snapshot())
    for change in NONSENSE + OWN[type(rear_of(filter_))]:
        with pytest.raises(ValueError, match="saved"):
            filter_.restore({**saved, **change})
        assert before == repr(filter_.snapshot()), change
    for key in saved:
        with pytest.raises(ValueError, match="saved"):
            filter_.restore({k: v for k, v in saved.items() if k != key})


@EACH
def test_a_belief_that_is_not_finite_says_so(method: str, drive: Drive) -> None:
    """NaN or infinity inside makes an estimate that `unsound_reason` has a reason against, or an arithmetic
    error; the pipeline then starts a new filter."""
    filter_ = estimator(method, drive.world)
    run(filter_, drive.ticks[:100])
    rear = rear_of(filter_)
    if isinstance(rear, MixtureBelief):
        rear.bank.covariance[:, -1, -1] = math.nan
    elif isinstance(rear, GaussianBelief):
        rear.mean[3] = math.inf
    else:
        assert isinstance(rear, SampledBelief)
        rear.particles.log_weights[0] = math.nan
    with np.errstate(invalid="ignore", over="ignore"):
        try:
            said = [unsound_reason(filter_.step(tick), [0, 1, 2, 3]) for tick in drive.ticks[100:110]]
        except (ArithmeticError, ValueError):
            return
    assert said[-1]


@pytest.mark.parametrize(("alias", "name"), list(ALIASES.items()))
def test_an_alias_is_the_filter_itself(alias: str, name: str, drive: Drive) -> None:
    """The name of an earlier version gives the same bits, and their snapshots are one another's."""
    a, b = (
        build_filter(VEHICLE, GnssConfig(), FilterConfig(method=m), np.random.default_rng(1), True)
        for m in (alias, name)
    )
    assert bits(run(a, drive.ticks[:150])) == bits(run(b, drive.ticks[:150]))
    a.restore(b.snapshot())
