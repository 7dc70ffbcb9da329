"""Encoders that lose counts, told on line from larger tyres, and what the monitor says of them."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
import pytest

from bench.campaigns.onboard.recorded_losses import play, read_drive
from bench.places import RECORDINGS
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tests.onboard.monitor.drives import VEHICLE
from tpmsd.foundation.wheels import RL, FloatArray
from tpmsd.onboard.monitor.health.encoder_watch import EncoderWatch
from tpmsd.onboard.timeline.tick import Tick

COUNTS = 40_000.0
MINUTE = 600
"""Ticks."""


@cache
def _rotation(deviation_m: float = 0.0) -> FloatArray:
    """(n, 4) of seven minutes on a motorway, rear rings 0.15 mm off centre; rl grows after 200 s."""
    physics: dict[str, dict[str, object]] = {
        "tone_ring_error": {"wheel": "rl", "amplitude_rad": 3e-3},
        "radius_change": {"wheel": "rl", "deviation_m": deviation_m, "onset_s": 200.0, "duration_s": 1.0},
    }
    spec = Spec(duration_s=420.0, road="motorway", teeth=COUNTS, physics=physics, radius_spread_m=0.0)
    rotation = recording_of(drive(spec, 4)).rotation_rad.copy()
    rotation[:, RL + 1] += np.diff(3e-3 * np.sin(np.append(0.0, np.cumsum(rotation[:, RL + 1]))))
    return rotation


def _watched(rotation: FloatArray, teeth: float = COUNTS) -> EncoderWatch:
    vehicle = dataclasses.replace(VEHICLE, teeth_per_rev=teeth)
    watch = EncoderWatch(vehicle, [0, 1, 2, 3])
    for k, turned in enumerate(rotation):
        watch.update(Tick(k, 0.1 * k, 0.1, turned, np.zeros(4)))
    return watch


def _losing(rotation: FloatArray, share: float, first: int = 0) -> FloatArray:
    out = rotation.copy()
    out[first:, RL] *= 1.0 - share
    return out


@pytest.mark.parametrize("since", [0, 3 * MINUTE])
def test_a_wheel_that_loses_counts_is_named_with_the_share(since: int) -> None:
    """Three in a thousand of the left rear wheel's counts, from the start or from half time on."""
    watch = _watched(_losing(_rotation(), 3e-3, since))

    assert [RL] == list(watch.losing)
    assert watch.losing[RL] == pytest.approx(3e-3, abs=4e-4)


@pytest.mark.parametrize("deviation_m", [0.0, 1e-3, -1e-3])
def test_a_tyre_of_another_size_loses_no_counts(deviation_m: float) -> None:
    """One millimetre is three in a thousand of the counts, but the ripple comes once per revolution."""
    assert {} == _watched(_rotation(deviation_m)).losing


def test_rings_of_few_teeth_are_not_watched() -> None:
    """Of 48 teeth a ripple is no part of a count."""
    assert {} == _watched(_losing(_rotation(), 3e-3), teeth=48.0).losing


def test_counts_that_are_no_longer_lost_are_forgotten() -> None:
    """Twelve minutes in order after seven with a loss: nothing is said any more."""
    sound = _rotation()

    assert {} == _watched(np.concatenate([_losing(sound, 3e-3), sound, sound])).losing


def test_a_gap_in_the_readings_is_no_lost_count() -> None:
    """A tick without a reading in each minute: no minute is whole, so nothing is said."""
    rotation = _losing(_rotation(), 3e-3)
    rotation[300::500] = math.nan

    assert {} == _watched(rotation).losing


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="recordings are not there")
@pytest.mark.parametrize(
    ("name", "expected"),
    [("van-motorway-lost-counts", [("malfunction", "rl", "raised")]), ("van-motorway-c", [])],
)
def test_the_recorded_encoder_that_loses_counts_is_a_malfunction(
    name: str, expected: list[tuple[str, str, str]]
) -> None:
    """The left encoder of a van lost 0.2 % of its counts on one drive; on another its tyre was larger."""
    drive_ = read_drive(RECORDINGS / name)
    events, _, _ = play(drive_.config, drive_.ticks)

    assert expected == [(str(event.kind), event.wheel, event.state) for event in events]
