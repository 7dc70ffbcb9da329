"""What a diagnosis measures is right to well below its standard deviation's own size, and what receivers and
wheels do beside is not taken for physics.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import STEP_S, Spec, drive
from tests.offline.diagnosis.recorded import PER_TICK, recording_of
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.diagnosis.assessment.result import RollingDiagnosis
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.hypotheses.response import calibration_columns, catalogue_columns
from tpmsd.offline.diagnosis.prepared.drive_regression import initial_noise
from tpmsd.offline.inference.stack import ColumnStack
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.whitening import whiten
from tpmsd.offline.inference.windows import Reader
from tpmsd.offline.rings.uneven_teeth import ripples

SILENT = {"position_slow_m": 1e-9, "position_white_m": 1e-9, "doppler_mps": 1e-9}
"""A receiver without errors."""


def diagnosed(seed: int, spec: Spec) -> RollingDiagnosis:
    """The diagnosis of a drive in memory."""
    return diagnose([recording_of(drive(spec, seed))])


def growth(seed: int) -> float:
    """Least squares of growth with speed on a drive without any, its receiver silent, in s2/m."""
    spec = Spec(duration_s=900.0, teeth=44.0, **SILENT)
    recording = recording_of(drive(spec, seed))
    reader = Reader(recording, reference(recording))
    columns = catalogue_columns(reader)
    at = columns.index()[("centrifugal_growth", "coefficient")]
    residual = reader.windows.measured - reader.predict(ExtendedModel())
    rows = (
        ColumnStack(residual) + calibration_columns(reader).stack + ColumnStack(columns.stack[at])
    ).whole()
    noise = replace(initial_noise(reader), slow_m=1.2, slow_tau_s=40.0, radius_drift=1e-6)
    white, _ = whiten(reader.windows, noise, rows)
    flat = white.reshape(-1, rows.shape[2])
    return float(np.linalg.lstsq(flat[:, 1:], flat[:, 0], rcond=None)[0][-1])


def test_reading_errors_of_counters_make_no_growth_with_speed() -> None:
    """The error of a count is in the residual and in the way; their product must not add up.

    It did: 7e-8 s2/m on the mean of such drives, a twentieth of what tyres show.
    """
    found = [growth(seed) for seed in range(4)]

    assert float(np.mean(found)) == pytest.approx(0.0, abs=2.5e-8)


def test_a_receiver_whose_speed_is_older_than_its_position_is_no_finding() -> None:
    """Every receiver filters its speed; taken for the age of its fixes it would be a false alarm."""
    diagnosis = diagnosed(31, Spec(duration_s=700.0, doppler_age_s=0.08))

    assert ("consistent", ()) == (diagnosis.verdict, diagnosis.findings)
    assert any("older than its position" in note for note in diagnosis.notes)


def test_a_radius_that_goes_down_and_comes_back_is_unknown_in_that_span() -> None:
    """No change of radius that stays would explain it: the span is found to the second."""
    span = {"wheels": [3], "from_s": 260.0, "to_s": 430.0, "size_m": -1.4e-3}
    diagnosis = diagnosed(32, Spec(duration_s=700.0, physics={"strange_span": span}))

    assert ["unknown"] == [finding.effect for finding in diagnosis.findings]
    where = diagnosis.findings[0].where
    assert ("rr",) == where.wheels
    assert where.time_spans[0] == pytest.approx((260.0, 430.0), abs=2.0)


def test_a_step_of_a_radius_is_measured_to_a_third_of_a_per_cent() -> None:
    """What is linear about the configured car is off by the step's own half a per cent and more."""
    truth = {"wheel": "fr", "deviation_m": -1.6e-3, "onset_s": 300.0, "duration_s": 0.0}
    diagnosis = diagnosed(33, Spec(duration_s=700.0, teeth=96.0, physics={"radius_change": truth}))

    values = {name: quantity.value for name, quantity in diagnosis.findings[0].parameters.items()}
    assert "fr" == values["wheel"]
    assert values["deviation_m"] == pytest.approx(-1.6e-3, rel=0.0035)
    assert values["onset_s"] == pytest.approx(300.0, abs=2.0)


@pytest.mark.parametrize(("wheel", "teeth"), [(1, 47), (2, 49)])
def test_a_ring_with_another_number_of_teeth_is_distinguished_from_another_radius(
    wheel: int, teeth: int
) -> None:
    """Two per cent on one wheel, just what a tooth makes: wheel and number are named."""
    world = drive(Spec(duration_s=300.0, teeth=48.0), 34)
    shown = world.shown_rad.copy()
    shown[:, wheel] *= teeth / 48.0
    diagnosis = diagnose([recording_of(replace(world, shown_rad=shown))])

    assert ["tone_ring_error"] == [finding.effect for finding in diagnosis.findings]
    values = {name: quantity.value for name, quantity in diagnosis.findings[0].parameters.items()}
    assert (("fl", "fr", "rl", "rr")[wheel], teeth) == (values["wheel"], values["teeth_per_rev"])


def test_heights_that_wander_on_a_flat_road_are_no_slopes() -> None:
    """Without an accelerometer slopes come from heights; what slip lacks by them is no finding."""
    slip = {"slip_per_accel": 2.3e-3, "slip_per_speed2": 6e-7}
    spec = Spec(duration_s=700.0, road="city", position_slow_m=3.0, position_tau_s=20.0)
    recording = recording_of(drive(replace(spec, physics={"longitudinal_slip": slip}), 35))
    silent = np.full_like(recording.inertial["accel_long_mps2"], np.nan)
    recording = replace(recording, inertial={**recording.inertial, "accel_long_mps2": silent})
    assert "heights" == reference(recording).grade_by
    diagnosis = diagnose([recording])

    assert ["longitudinal_slip"] == [finding.effect for finding in diagnosis.findings]
    values = {name: quantity.value for name, quantity in diagnosis.findings[0].parameters.items()}
    assert values["slip_per_accel"] == pytest.approx(2.3e-3, rel=0.03)
    assert any("heights" in note for note in diagnosis.notes)


def test_a_ripple_that_readings_flatten_has_its_size_all_the_same() -> None:
    """At one reading in 60 ms a wheel turns by half a turn and more between two: what lies on the line
    between them is less than half of the ripple.
    """
    size = 0.008
    spec = Spec(duration_s=600.0, physics={"tone_ring_error": {"wheel": "rl", "amplitude_rad": size}})
    world = drive(spec, 61)
    every = 3
    sampled_s = 0.02 * np.arange(len(world.shown_rad))
    edges_s = sampled_s[::PER_TICK]
    angle = [np.interp(edges_s, sampled_s[::every], one) for one in world.shown_rad[::every].T]
    recording = replace(recording_of(world), rotation_rad=np.diff(np.stack(angle, axis=1), axis=0))
    found = ripples(recording, reference(recording))

    assert "rl" == found[0].wheel
    assert found[0].amplitude_rad == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize("seed", [3, 6])
def test_a_change_while_the_car_stands_has_an_onset_as_unsure_as_the_stop(seed: int) -> None:
    """A tyre that loses 2 mm in a stop of 20 s: its onset is told within three standard deviations."""
    made = drive(Spec(duration_s=420.0, road="city", stops=True, teeth=96), seed)
    stands = np.concatenate([[False], made.speed < 0.05, [False]]).astype(int)
    begins, ends = np.flatnonzero(np.diff(stands) > 0), np.flatnonzero(np.diff(stands) < 0)
    inner = [(a, b) for a, b in zip(begins, ends, strict=True) if 100.0 < STEP_S * a and STEP_S * b < 330.0]
    stop = max(inner, key=lambda span: span[1] - span[0])
    lost_s = STEP_S * stop[1] - 2.0
    plain = recording_of(made)
    rotation = plain.rotation_rad.copy()
    rotation[plain.dt_s * np.arange(len(rotation)) > lost_s, 2] *= 1.0 + 2e-3 / plain.car.radius_m[2]
    found = diagnose([replace(plain, rotation_rad=rotation)]).findings[0]
    onset = found.parameters["onset_s"]

    assert STEP_S * (stop[1] - stop[0]) > 20.0
    assert "radius_change" == found.effect
    assert onset.std is not None
    assert abs(float(onset.value) - lost_s) < 3.0 * onset.std
    assert onset.std < 40.0
