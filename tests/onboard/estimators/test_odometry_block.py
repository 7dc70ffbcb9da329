"""Blocks: sums of what turned, ways by Doppler, and front wheels against the rear pair's hub paths."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.estimators.world import RADIUS_M, START_S, TRACK_M, WHEELBASE_M, Receiver, World
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.onboard.estimators.odometry_block import Block, BlockBuilder
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Tick

ORDER = [2, 3, 0, 1]
CLEAN = Receiver(position_std_m=1e-9, white_std_m=0.0, velocity_std_mps=0.0)
FRONT_TRACK_M = 1.47


def builder(order: list[int] | None = None, track_front_m: float = TRACK_M) -> BlockBuilder:
    order = ORDER if order is None else order
    return BlockBuilder(
        order, np.full(len(order), RADIUS_M), WheelPositions(track_front_m, TRACK_M, WHEELBASE_M)
    )


def blocks_of(ticks: list[Tick], radii: tuple[float, ...] = (0.0,) * 4) -> list[tuple[int, Block]]:
    made = builder()
    out = []
    for tick in ticks:
        for fix in tick.fixes:
            made.add_fix(fix, tick)
        block = made.add(tick, True, np.array(radii), 0.0)
        if block is not None:
            out.append((tick.index, block))
    return out


def world(**changes: object) -> World:
    return replace(
        World(duration_s=40.0, teeth=math.inf, offsets_m=(0.0,) * 4, receiver=CLEAN),
        **changes,  # type: ignore[arg-type]
    )


@settings(derandomize=True, deadline=None, max_examples=15)
@given(st.floats(8.0, 30.0), st.floats(-1.5, 1.5), st.sampled_from([0.1, 0.2, 0.25, 1.0]))
def test_the_distance_by_doppler_is_exact_for_steady_acceleration(
    speed: float, accel: float, period_s: float
) -> None:
    """Speeds that change linearly: the trapezoid is the very way, and equals that of the wheels."""
    at_10_s = world(
        duration_s=8.0,
        speed_mps=lambda t: speed + accel * (t - 4.0),
        yaw_radps=lambda t: np.zeros_like(t),
        receiver=replace(CLEAN, period_s=period_s),
    )
    found = blocks_of(at_10_s.drive().ticks)
    assert len(found) >= 3
    for _, block in found[1:]:
        # Rotation within a tick is taken as even, which leaves a share of one tick's change of speed.
        slack = abs(accel) * 0.1 * 0.1
        assert block.doppler_distance_m == pytest.approx(block.distance_m, abs=slack + 1e-4)
        assert accel * block.duration_s == pytest.approx(block.speed_change_mps, abs=1e-4)
        assert 0.85 < block.duration_s < 1.2


def test_blocks_add_up_to_the_ticks() -> None:
    """Doppler blocks follow each other without gap or overlap: their rotations sum to that of all ticks."""
    ticks = world().drive().ticks
    found = blocks_of(ticks)
    begin = min(fix.time_s for tick in ticks for fix in tick.fixes)
    total = np.sum([block.angle_rad for _, block in found], axis=0)
    spent = sum(block.duration_s for _, block in found)
    last = begin + spent
    expected = np.zeros(4)
    for tick in ticks:
        share = (min(tick.time_s, last) - max(tick.time_s - tick.dt_s, begin)) / tick.dt_s
        expected += min(max(share, 0.0), 1.0) * tick.rotation_rad[ORDER]
    assert spent > 35.0
    assert expected == pytest.approx(total, rel=3e-6)  # stamps resolve 0.24 us


def test_without_doppler_blocks_are_ended_by_time() -> None:
    """No speeds: blocks of whole ticks, whose rotations are those of their ticks, and no way by Doppler."""
    ticks = world(receiver=replace(CLEAN, doppler=False)).drive().ticks
    found = blocks_of(ticks)
    assert len(found) >= 14
    first = 0
    for index, block in found:
        assert math.isnan(block.doppler_distance_m)
        assert SETTINGS.block_max_s == pytest.approx(block.duration_s, abs=0.11)
        expected = np.sum([tick.rotation_rad[ORDER] for tick in ticks[first:index]], axis=0)
        assert expected == pytest.approx(block.angle_rad)
        first = index


def test_front_wheels_agree_with_the_rear_pair_in_a_bend() -> None:
    """Consistent kinematics, also in bends: each front wheel's path is the one predicted, to 0.1 mm per m."""
    bend = world(speed_mps=lambda t: 12.0 + 0.0 * t, yaw_radps=lambda t: 0.15 * np.sin(t / 3.0))
    found = blocks_of(bend.drive().ticks)
    assert max(abs(block.heading_change_rad) for _, block in found) > 0.12
    for _, block in found[1:]:
        for front in block.front:
            assert front is not None
            assert 0.0 == pytest.approx(front.residual_m, abs=1e-4 * block.distance_m)


def test_a_smaller_front_wheel_shows_in_its_own_residual() -> None:
    """A front radius 1 % below nominal leaves a residual of minus 1 % of the way at that wheel alone."""
    small = world(offsets_m=(-0.01 * RADIUS_M, 0.0, 0.0, 0.0), yaw_radps=lambda t: np.zeros_like(t))
    for _, block in blocks_of(small.drive().ticks)[1:]:
        left, right = block.front
        assert left is not None
        assert right is not None
        assert -0.01 / 0.99 == pytest.approx(left.residual_m / block.distance_m, rel=1e-3)
        assert 0.0 == pytest.approx(right.residual_m, abs=1e-6)


def test_derivatives_of_the_hub_paths() -> None:
    """How a front residual changes with the rear radii, and with the track, is what the block says."""
    ticks = world(yaw_radps=lambda t: 0.05 * np.sin(t / 3.0)).drive().ticks[:40]
    base = blocks_of(ticks)[1][1]
    for side in (0, 1):
        front = base.front[side]
        assert front is not None
        for k in range(2):
            radii = [0.0] * 4
            radii[k] = 1e-4
            moved = blocks_of(ticks, tuple(radii))[1][1].front[side]
            assert moved is not None
            # Second order of the hub's lateral part is left out: some per cent in a bend.
            numeric = (moved.residual_m - front.residual_m) / 1e-4
            assert numeric == pytest.approx(front.by_rear[k], rel=0.05, abs=1.0)
        sign = (-1.0, 1.0)[side]
        assert sign * TRACK_M / 2 == pytest.approx(front.by_track_m)


def test_a_wheel_without_signal_leaves_its_residual_out() -> None:
    """One NaN at a front wheel drops that wheel from the block; at a rear wheel, the block."""
    ticks = world().drive().ticks
    odd = list(ticks)
    odd[104] = replace(odd[104], rotation_rad=np.where(np.arange(4) == 0, np.nan, odd[104].rotation_rad))
    hit = next(block for index, block in blocks_of(odd) if index >= 105)
    assert (True, False) == (hit.front[0] is None, hit.front[1] is None)
    assert np.all(np.isfinite(hit.angle_rad[:2]))
    odd[204] = replace(odd[204], rotation_rad=np.where(np.arange(4) == 2, np.nan, odd[204].rotation_rad))
    ends = [index for index, _ in blocks_of(odd)]
    assert max(np.diff(ends)) > max(np.diff([index for index, _ in blocks_of(ticks)]))
    assert all(np.all(np.isfinite(block.angle_rad[:2])) for _, block in blocks_of(odd))


def test_a_pause_of_the_receiver_makes_no_distance_of_it() -> None:
    """Speeds further apart than a block are not joined by a trapezoid."""
    ticks = world(receiver=replace(CLEAN, outage=(10.0, 20.0))).drive().ticks
    for index, block in blocks_of(ticks):
        end_s = ticks[index - 1].time_s - START_S
        if 10.5 < end_s < 20.0:
            assert math.isnan(block.doppler_distance_m)
        assert block.duration_s <= SETTINGS.block_max_s + 0.2


def test_the_rear_pair_alone_has_no_front_residuals() -> None:
    """With two wheels on the bus there is nothing to predict."""
    made = builder([2, 3])
    for tick in world().drive().ticks:
        block = made.add(tick, True, np.zeros(2), 0.0)
        if block is not None:
            assert (None, None) == block.front
            assert (2,) == block.angle_rad.shape
