"""Drives drawn again from a model, against what the model predicts for the same motion."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import make_effect, probes
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.replicate import replicate
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader

LARGE = (
    make_effect("velocity_lag", lag_s=0.5),
    make_effect("gnss_latency", latency_s=0.4),
    make_effect("longitudinal_slip", slip_per_accel=6e-3, slip_per_speed2=2e-6),
)


@pytest.fixture(scope="module")
def reader() -> Reader:
    """Four minutes with hills, wheels without steps."""
    recording = recording_of(drive(Spec(duration_s=240.0, hilly=0.03), 3))
    return Reader(replace(recording, quantum_rad=np.zeros(4)), reference(recording))


@pytest.fixture(scope="module")
def noise(reader: Reader) -> Noise:
    """Of no size; time constants as they are."""
    first = Noise.first(reader.recording.quantum_rad, reader.reference.car.radius_m)
    sizes = {
        one.name: 0.0 for one in fields(first) if not one.name.endswith(("tau_s", "memory", "reading_m"))
    }
    return replace(first, **sizes, reading_m=np.zeros(4))


def shown(reader: Reader, model: ExtendedModel, noise: Noise) -> FloatArray:
    """(w, 9) what the channels of a replicate read."""
    drawn = replicate(reader, model, noise, np.random.default_rng(1))
    return Reader(drawn, reader.reference, kept=reader.windows.index).windows.measured


def test_each_effect_acts_in_a_replicate_as_in_a_prediction(reader: Reader, noise: Noise) -> None:
    """Every effect, large ones too, changes a replicate by what it changes the prediction."""
    effects: list[Effect] = [*(probe.probing_effect() for probe in probes()), *LARGE]
    before, predicted = shown(reader, ExtendedModel(), noise), reader.predict(ExtendedModel())
    assert np.nan_to_num(before - predicted) == pytest.approx(np.zeros(before.shape), abs=1e-6)
    for effect in effects:
        model = ExtendedModel((effect,))
        expected = np.nan_to_num(reader.predict(model) - predicted)
        changed = np.nan_to_num(shown(reader, model, noise) - before)
        scale = np.abs(expected).max()
        assert changed == pytest.approx(expected, abs=1e-3 * scale + 1e-6), effect
