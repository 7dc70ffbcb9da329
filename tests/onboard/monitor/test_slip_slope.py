"""The slip of driven wheels per acceleration, and what it says of grip."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.monitor.drives import RADIUS_M, VEHICLE
from tests.onboard.monitor.test_drive_evidence import NOISE_M, RADIUS, WHEELS, at, learned_car
from tpmsd.car.config.model import MonitorConfig, TyreConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.alarms.judge import Judge, Judgement
from tpmsd.onboard.monitor.baseline.baseline import Change
from tpmsd.onboard.monitor.baseline.reference import DRAG, HILL, RadiusReference
from tpmsd.onboard.monitor.evidence.hypotheses import Comparison
from tpmsd.onboard.monitor.sampling.drive_evidence import DriveEvidence
from tpmsd.onboard.monitor.sampling.slip_slope import SlipSlope
from tpmsd.onboard.monitor.sampling.slip_sums import Slope, SlopeSums
from tpmsd.onboard.monitor.settings import JUDGE, SLIP_SLOPE
from tpmsd.onboard.timeline.tick import Tick

DT_S = 0.1
DRY = 7e-3
"""Slip per m/s2."""
ASKED = MonitorConfig().raise_probability


def ticks(
    seconds: float,
    slope: float,
    *,
    driven: str = "front",
    larger_m: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    yaw_radps: float = 0.0,
    side_slip: float = 0.0,
    braked: bool = False,
    teeth: float = 0.0,
    hill_mps2: float = 0.0,
    seed: int = 0,
) -> list[Tick]:
    """Speed swings by 4 m/s about 18 m/s in 25 s. `larger_m`: radii beyond nominal; `side_slip`: angle of the
    front wheels per lateral acceleration, by whose cosine they roll less; `braked`: what is more than an
    engine's braking by 0.4 m/s2, all wheels do alike; `teeth` per revolution: whole ones are counted (0: no
    rounding); `hill_mps2`: slopes of the road, a random walk of so much in 20 s."""
    time = np.arange(round(seconds / DT_S)) * DT_S
    phase = 2.0 * math.pi * time / 25.0 + seed
    speed, accel = 18.0 + 4.0 * np.sin(phase), 4.0 * 2.0 * math.pi / 25.0 * np.cos(phase)
    track, base = VEHICLE.track_rear_m, VEHICLE.wheelbase_m
    rng = np.random.default_rng(seed)
    force = accel + np.cumsum(rng.normal(0.0, hill_mps2 * math.sqrt(DT_S / 20.0), time.size))
    side = np.array([-0.5, 0.5, -0.5, 0.5]) * track * yaw_radps
    along = speed[:, None] + side
    ahead = np.array([1.0, 1.0, 0.0, 0.0]) * base * yaw_radps
    steered = np.cos(side_slip * speed * yaw_radps)[:, None] ** np.array([1.0, 1.0, 0.0, 0.0])
    rate = np.hypot(along, ahead) * steered / (RADIUS_M + np.array(larger_m))
    if braked:
        force = np.where(accel < -0.4, 0.0, force)
    pulled = np.array([1.0, 1.0, 0.0, 0.0]) if driven == "front" else np.array([0.0, 0.0, 1.0, 1.0])
    turned = np.cumsum(rate * (1.0 + slope * force[:, None] * pulled) * DT_S, axis=0)
    if teeth:
        start = rng.uniform(0.0, 1.0, 4)
        turned = np.floor(turned * teeth / (2.0 * math.pi) + start) * 2.0 * math.pi / teeth
    turns = np.diff(turned, axis=0)
    return [
        Tick(index=k, time_s=float(t), dt_s=DT_S, rotation_rad=turn, rotation_std_rad=np.full(4, 0.05))
        for k, (t, turn) in enumerate(zip(time[1:], turns, strict=True))
    ]


def sums_of(found: list[Tick], driven: str = "front") -> SlopeSums:
    slip = SlipSlope(replace(VEHICLE, driven_axle=driven))
    total = SlopeSums()
    for tick in found:
        total += slip.update(tick) or SlopeSums()
    return total


@pytest.mark.parametrize("driven", ["front", "rear"])
@pytest.mark.parametrize("larger_m", [(0.0,) * 4, (-2e-3, -2e-3, 0.0, 0.0), (0.0, 0.0, -3e-3, 1e-3)])
def test_the_slope_is_that_of_the_slip_whatever_the_radii(driven: str, larger_m: tuple[float, ...]) -> None:
    wheels = (larger_m[0], larger_m[1], larger_m[2], larger_m[3])
    found = sums_of(ticks(100.0, DRY, driven=driven, larger_m=wheels), driven).slope()
    assert found is not None
    # Of a swing of 25 s a difference over two seconds is smaller than its derivative by sin(x) / x, the mean
    # of one second by the same of x / 2.
    x = 2.0 * math.pi / 25.0
    assert found[0] == pytest.approx(2.0 * DRY * math.sin(x / 2.0) / math.sin(x), rel=0.01)


def test_a_bend_is_no_slip() -> None:
    """Front wheels roll further in a bend; what of that goes with speed is taken out."""
    found = sums_of(ticks(100.0, 0.0, yaw_radps=0.25)).slope()
    assert found is not None and abs(found[0]) < 1e-4


def test_stated_errors_cover_rounded_counts_and_hills() -> None:
    """Of 100 drives of a minute with 48 teeth over slopes that change by 1 % in 20 s, 95 % and more are
    within 1.96 standard deviations, which are at most four times as wide as the errors."""
    off = []
    for seed in range(100):
        found = sums_of(ticks(60.0, DRY, teeth=48.0, hill_mps2=0.1, seed=seed)).slope()
        assert found is not None
        off.append((found[0] - 1.01 * DRY) / math.sqrt(found[1]))
    assert np.mean(np.abs(off) < 1.96) >= 0.95
    assert np.std(off) > 0.25


def test_nothing_is_said_where_nothing_can_be_known() -> None:
    drive = ticks(60.0, DRY)
    assert sums_of(drive, "all").slope() is None
    stood = [replace(one, rotation_rad=np.zeros(4)) for one in drive]
    assert sums_of(stood).slope() is None
    steady = [replace(one, rotation_rad=np.full(4, 18.0 * DT_S / RADIUS_M)) for one in drive]
    assert sums_of(steady).slope() is None


@pytest.mark.parametrize("driven", ["front", "rear"])
@pytest.mark.parametrize("wheel", WHEELS)
def test_a_wheel_that_is_not_received_leaves_no_slope(driven: str, wheel: int) -> None:
    """Whichever it is; half a minute of it is no reason to forget the rest."""
    drive = ticks(60.0, DRY, driven=driven)
    lost = np.where(np.arange(4) == wheel, math.nan, 0.0)
    silent = [replace(one, rotation_rad=one.rotation_rad + lost) for one in drive]
    assert sums_of(silent, driven) == SlopeSums()
    part = sums_of([*silent[:200], *drive[200:]], driven).slope()
    assert part is not None and part[0] == pytest.approx(1.01 * DRY, rel=0.02)


def test_a_hill_that_goes_with_the_acceleration_is_within_the_stated_error() -> None:
    """The car speeds up by 0.3 m/s2 for 10 s and slows down for 10 s, and the road is 1 % steeper while it
    speeds up: no residual tells, and the slope is too large by a sixth. Of 8e-3 per m/s2 that is 0.71 of the
    standard deviation for 0.1 m/s2 that last 10 s."""
    slip, time = 8e-3, np.arange(202) * DT_S
    up = time < 10.05
    accel = np.where(up, 0.3, -0.3)
    distance = (15.0 + np.cumsum(accel) * DT_S) * DT_S
    found = []
    for hill_mps2 in (0.0, 0.1):
        extra = 1.0 + np.outer(slip * (accel + hill_mps2 * up), [1.0, 1.0, 0.0, 0.0])
        turns = distance[:, None] * extra / RADIUS_M
        drive = [Tick(k, k * DT_S, DT_S, turn, np.full(4, 0.05)) for k, turn in enumerate(turns)]
        found.append(sums_of(drive).slope())
    level, hilly = found
    assert level is not None and hilly is not None
    assert hilly[0] / level[0] == pytest.approx(7.0 / 6.0, rel=0.01)
    assert (hilly[0] - level[0]) / math.sqrt(hilly[1]) == pytest.approx(math.sqrt(0.5), rel=0.15)


@pytest.mark.parametrize("yaw_radps", [0.6, -0.6])
def test_side_slip_in_tight_bends_is_not_taken_for_force(yaw_radps: float) -> None:
    """In bends of 23 to 37 m front wheels at 2 degrees per m/s2 roll less than their way: on a drive of
    tight bends alone nothing is said, and beside as long a straight one that one's slope."""
    tight = ticks(100.1, DRY, yaw_radps=yaw_radps, side_slip=0.035, seed=1)
    assert sums_of(tight) == SlopeSums()
    straight = ticks(100.1, DRY)
    both, alone = sums_of([*straight, *tight]).slope(), sums_of(straight).slope()
    assert both is not None and both == pytest.approx(alone, rel=1e-3)


def test_speed_that_changed_in_a_gap_is_no_acceleration() -> None:
    """Of every 8 s the last 3 s were not recorded: the slope is that of the whole drive."""
    drive, kept, missing = ticks(200.0, DRY), [], 0
    for one in drive:
        if one.index % 80 >= 50:
            missing += 1
            continue
        kept.append(replace(one, gap_s=missing * DT_S))
        missing = 0
    found = sums_of(kept).slope()
    assert found is not None and found[0] == pytest.approx(1.01 * DRY, rel=0.01)


def test_braking_is_done_by_all_wheels() -> None:
    """Harder than an engine brakes no axle slips beyond the other: the slope is that of pulling."""
    found = sums_of(ticks(200.0, DRY, braked=True)).slope()
    assert found is not None and found[0] == pytest.approx(1.01 * DRY, rel=0.05)


def test_slopes_are_learned_as_the_slip_on_hills() -> None:
    """Ten measurements of one slope with 1e-3 each, from a prior of 4e-3 +- 4e-3: their weighted mean."""
    reference = RadiusReference(VEHICLE)
    prior = reference.covariance[HILL, HILL]
    information = 10.0 / (1e-6 + 0.0)
    for _ in range(10):
        reference.learn_slip(Slope(DRY, 1e-6))
    both = float(prior[0, 0] + prior[1, 1])
    gain = both / (both + 1.0 / information)
    axles = reference.mean[HILL]
    assert axles[1] - axles[0] == pytest.approx(4e-3 + gain * (DRY - 4e-3), rel=1e-6)


def judged(extra: FloatArray, slippier: float, seed: int) -> Judgement:
    """Of a drive with a known car and a slip slope every 20 s; driven wheels slip so many times as much as
    they did when the car was learned, uphill from the eighth sample on, and `extra` (n, 4) m comes on top."""
    rng = np.random.default_rng(seed)
    reference = learned_car()
    reference.mean[HILL.start] = -DRY
    truth = reference.mean.copy()
    truth[[DRAG, HILL.start]] *= slippier
    evidence = DriveEvidence(reference, WHEELS, RADIUS)
    noise_m2 = np.eye(4) * NOISE_M**2
    changes = []
    for k, more in enumerate(extra):
        uphill = replace(at(22.0 + 3.0 * math.sin(k / 3.0)), slope_mps2=0.5 if k >= 8 else 0.0)
        features = reference.features(uphill)
        seen = features @ truth * RADIUS_M + more + rng.normal(0.0, NOISE_M, 4)
        measured = slippier * DRY + float(rng.normal(0.0, 2.5e-3))
        evidence.update(seen, noise_m2, np.zeros((4, 4)), features, 20.0, Slope(measured, 2.5e-3**2))
        changes.append(seen - features @ reference.mean * RADIUS_M)
    recent = np.mean(changes[-JUDGE.full_samples :], axis=0)
    now = Change(changes[-1], noise_m2, 1, noise_m2, True)
    mean = Change(recent, noise_m2, JUDGE.full_samples, noise_m2, True)
    judge = Judge(VEHICLE, MonitorConfig(), TyreConfig(), WHEELS)
    return judge.judge(now, mean, change_hypotheses=evidence.change_hypotheses)


@pytest.mark.parametrize("seed", range(5))
def test_the_slope_tells_low_grip_from_two_soft_driven_tyres(seed: int) -> None:
    """Both driven wheels are smaller by 1.3 mm after three minutes: by loss of air on a dry road, where both
    are named; by 2.2 times the slip on an uphill road, where nothing is raised."""
    soft = np.zeros((30, 4))
    soft[8:, :2] = -1.3e-3
    dry, slippery = judged(soft, 1.0, seed), judged(np.zeros((30, 4)), 2.2, seed)
    assert [0, 1] == np.flatnonzero(dry.deflated > ASKED).tolist()
    assert dry.slippery < 0.1
    assert slippery.slippery > 0.7
    assert np.all(slippery.deflated < ASKED)


@pytest.mark.parametrize(
    ("model", "lost", "left"),
    [
        ("evenly low grip", (0, 1), 0.2),
        ("evenly low grip", (2, 3), 1.0),
        ("low grip", (2, 3), 0.2),
        ("low grip", (0, 1, 2, 3), 0.2),
        ("evenly low grip", (0, 1, 2, 3), 1.0),
        ("low grip", (0,), 1.0),
        ("loose ground", (1, 2), 1.0),
    ],
)
def test_what_grip_leaves_of_a_loss(model: str, lost: tuple[int, ...], left: float) -> None:
    """Of a loss of 3 mm that is certain as such, on a car with a driven front axle: nothing of two driven
    wheels while the road is slippery, nothing of an axle or all wheels while grip fluctuates (0.8 each),
    all of what stands out beside the other wheel."""
    judge = Judge(VEHICLE, MonitorConfig(), TyreConfig(), WHEELS)
    change = np.zeros(4)
    change[list(lost)] = -3e-3
    verdict = Comparison(RADIUS, 0.0025).compare(change, 1e-4**2 * np.eye(4))
    large = np.exp(verdict.table.large - verdict.table.log_total)
    found = large.sum(axis=0) @ judge._drive_loss_fraction({"as learned": 0.2, model: 0.8})
    expected = np.zeros(4)
    expected[list(lost)] = left
    assert found == pytest.approx(expected, abs=1e-3)


def test_what_a_known_car_does_on_a_slippery_road_is_not_learned() -> None:
    found = judged(np.zeros((30, 4)), 2.2, 3)
    assert not found.may_learn(settled=True)
    assert found.may_learn(settled=False)
    assert judged(np.zeros((30, 4)), 1.0, 3).may_learn(settled=True)


@pytest.mark.parametrize(("low", "learns"), [(0.2, True), (0.7, False)])
def test_a_settled_car_learns_nothing_where_the_road_is_probably_slippery(low: float, learns: bool) -> None:
    """No loss is suspected at all; half of the probability is that of loose ground. What is not settled yet
    learns in either case."""
    models = {"as learned": 1.0 - low, "low grip": 0.5 * low, "loose ground": 0.5 * low}
    found = replace(Judgement.unknown(), suspicion=0.0, drive_models=models)
    assert learns == found.may_learn(settled=True)
    assert found.may_learn(settled=False)


def test_settings_are_those_of_the_source() -> None:
    """A road of 1 % more slope is 0.1 m/s2 more force."""
    assert SLIP_SLOPE.hill_std_mps2 == pytest.approx(9.81 * 0.01, rel=0.03)
