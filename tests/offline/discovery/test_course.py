"""Track, antenna and load by the receiver's course, against the equation that they obey."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.course import course_fit
from tpmsd.offline.discovery.reference import ReceiverMotion
from tpmsd.offline.discovery.result import Estimate
from tpmsd.offline.discovery.settings import SETTINGS

TRACK_M, AHEAD_M, LATENCY_S, SLIP = 1.62, 1.3, 0.12, 3e-3


def drive(
    load: float, noise_mps: float, difference_noise: float = 0.0
) -> tuple[FloatArray, FloatArray, ReceiverMotion]:
    """Speed and difference of the rear wheels, and a reference, over twelve minutes of mixed speeds."""
    rng = np.random.default_rng(4)
    cell = SETTINGS.cell_s
    edges = cell * np.arange(1441)
    centre = 0.5 * (edges[1:] + edges[:-1])
    speed = 12.0 + 7.0 * np.sin(2 * np.pi * centre / 170.0) + 3.0 * np.sin(2 * np.pi * centre / 41.0)
    bend = np.sin(2 * np.pi * centre / 23.0) * np.sin(2 * np.pi * centre / 61.0)
    yaw = 2.5 * bend / np.maximum(speed, 4.0)
    heading = cell * (np.cumsum(yaw) - 0.5 * yaw)
    course = heading + AHEAD_M * yaw / speed - LATENCY_S * yaw - SLIP * yaw * speed
    course = course + noise_mps / speed * rng.standard_normal(len(course))
    difference = TRACK_M * yaw * (1.0 + load * speed**2) + difference_noise * rng.standard_normal(len(yaw))
    empty = np.full(len(centre), np.nan)
    return speed, difference, ReceiverMotion(edges, speed, yaw, empty, centre, speed, course, False)


@pytest.mark.parametrize("load", [0.0, 4e-4])
def test_track_and_antenna(load: float) -> None:
    """The track is right to 1 %, the antenna within two standard errors, the load to first order."""
    speed, difference, reference = drive(load, 0.03)
    made = course_fit(speed, difference, reference, Estimate(LATENCY_S, 0.01))
    assert made is not None
    assert pytest.approx(-load, rel=0.2, abs=2e-5) == made.value[5]
    assert pytest.approx(TRACK_M, rel=0.01) == 1.0 / made.value[0]
    assert made.std(0) * TRACK_M**2 < 0.03
    assert pytest.approx(AHEAD_M, abs=2 * made.std(3)) == made.value[3]
    assert made.std(3) < 0.3


@pytest.mark.parametrize("load", [2e-4, 6e-4])
def test_a_load_that_the_drive_hardly_shows(load: float) -> None:
    """A noisy receiver leaves load and track together to the priors of cars, within their stated errors."""
    speed, difference, reference = drive(load, 1.0)
    made = course_fit(speed, difference, reference, Estimate(LATENCY_S, 0.01))
    assert made is not None
    std = made.std(0) / made.value[0] ** 2
    assert pytest.approx(TRACK_M, abs=2 * std) == 1.0 / made.value[0]
    assert std < SETTINGS.track_std_m


def test_a_noisy_heading_leaves_the_track_to_its_prior() -> None:
    """Where the difference is mostly noise its slope is too small; the stated error covers the truth."""
    speed, difference, reference = drive(0.0, 0.03, difference_noise=0.3)
    made = course_fit(speed, difference, reference, None)
    assert made is not None
    std = made.std(0) / made.value[0] ** 2
    assert pytest.approx(TRACK_M, abs=2 * std) == 1.0 / made.value[0]
    assert std > 0.03
