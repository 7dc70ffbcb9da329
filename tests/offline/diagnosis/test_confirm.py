"""What only the receiver shows does not rest on which of its positions were called outliers."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.worlds.instruments import Drive
from bench.worlds.origins import ORIGINS, Places
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.diagnose import diagnose

SEED = 50953
"""Two reflections of 4 m, each over 20 s, in a slow error of 2 m that lasts 80 s."""


@cache
def reflected() -> Drive:
    """A car of constant radii under a receiver with reflections."""
    origin, rng = ORIGINS["latched"], np.random.default_rng([SEED, sum(map(ord, "latchednull"))])
    return origin.drive(origin.spec(rng), rng, SEED, Places(Path(), Path(), held_out=True))[1]


@pytest.mark.parametrize("grows_m", [0.0, 4e-3])
def test_reflections_with_small_weight_make_no_warm_up(grows_m: float) -> None:
    """With the positions that contradict it at a small weight, a warm-up of 2 mm gains 80 nats; a true one of
    4 mm is found beside the same reflections.
    """
    recording = recording_of(reflected())
    warm = 1.0 - np.exp(-recording.edges_s[1:] / 700.0)
    radius_m = recording.car.radius_m[0] + grows_m * warm
    turned = recording.rotation_rad * (recording.car.radius_m[0] / radius_m)[:, None]

    findings = diagnose([replace(recording, rotation_rad=turned)]).findings

    assert [one.effect for one in findings] == (["thermal_growth"] if grows_m else [])
