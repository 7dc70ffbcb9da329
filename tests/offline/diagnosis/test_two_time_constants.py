"""An effect with two parameters that enter nonlinearly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import EFFECTS, probe_groups
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.hypotheses.one_drive import DriveHypotheses
from tpmsd.offline.diagnosis.hypotheses.penalties import grid_penalty
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression

HEAT = next(
    group for group in probe_groups() if group[0].effect == "brake_heat" and group[0].wheel_pattern == "front"
)


def _lagged(values: FloatArray, step_s: float, tau_s: float) -> FloatArray:
    """(n,) y' = (x - y) / tau by Euler's method."""
    out = np.zeros(len(values))
    for k in range(1, len(values)):
        out[k] = out[k - 1] + (values[k - 1] - out[k - 1]) * step_s / tau_s
    return out


@pytest.mark.parametrize("soak_s", [12.0, 60.0])
def test_how_soon_and_how_long_a_brake_warms_its_tyres(soak_s: float) -> None:
    """Both time constants and the growth within four standard deviations, and nothing beside them: where the
    tyre is taken to be warm at once, half of the growth was missing, with a second axle that warms."""
    growth, cooling_s = 2e-6, 150.0
    recording = recording_of(drive(Spec(duration_s=600.0, road="city", radius_drift=0.0), 8))
    motion = Regression(admitted_readers([recording])[0]).drives[0].reader.reference.motion
    power = np.maximum(-motion.specific_force_long_mps2, 0.0) * motion.speed_mps
    step_s = float(motion.time_s[1])
    heat = cooling_s * _lagged(_lagged(power, step_s, soak_s), step_s, cooling_s)[: recording.ticks]
    change = growth * heat[:, None] * np.array([1.0, 1.0, 0.0, 0.0])
    turns = recording.rotation_rad / (1.0 + change / recording.car.radius_m)
    findings = diagnose([replace(recording, rotation_rad=turns)]).findings

    assert ["brake_heat"] == [one.effect for one in findings]
    found = findings[0].parameters
    for name, true in (("growth", growth), ("cooling_s", cooling_s), ("soak_s", soak_s)):
        value, std = float(found[name].value), float(found[name].std or 0.0)
        assert value == pytest.approx(true, abs=4.0 * std)
        assert std < true


def test_both_values_off_the_grid_are_priced() -> None:
    """Half a minute costs nothing; a factor of e^1.1 from it half a nat."""
    hypotheses = DriveHypotheses([("data",), *(probe.key for probe in HEAT)], np.zeros(0), frozenset())
    (like,) = hypotheses.catalogue
    hypotheses.widen(4)
    assert like.at is not None

    hypotheses.add_off_grid(like, like.at, columns=(2,), second=30.0)
    hypotheses.add_off_grid(like, like.at, columns=(3,), second=30.0 * float(np.exp(1.1)))

    usual, long = hypotheses.catalogue[1:]
    assert [0.0, 0.5] == pytest.approx([usual.penalty - like.penalty, long.penalty - like.penalty])
    assert (30.0, like.at) == (usual.second, usual.at)
    assert grid_penalty(EFFECTS["brake_heat"], None) == 0.0
