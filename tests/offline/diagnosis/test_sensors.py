"""Errors of accelerometers, steering wheel and clock are named where they are larger than usual."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.instruments import Drive
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.sensors.errors import fit_sensor_errors
from tpmsd.offline.diagnosis.sensors.readings import CLOCK, ROLES, rows_of
from tpmsd.offline.diagnosis.sensors.unusual import deviations_beyond, unusual
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader
from tpmsd.offline.report.diagnosis_summary import CHANNELS, location_text

SPEC = Spec(duration_s=400.0, road="mixed", hilly=0.02)
SEED = 3
GRAVITY = 9.81


def reader_of(recording: Recording) -> Reader:
    """Its motion and its windows."""
    return Reader(recording, reference(recording))


def turned(sound: Drive, angle: float) -> Drive:
    """A bracket that is turned about the vertical: rotation of the vector, not its linear part."""
    c, s = math.cos(angle), math.sin(angle)
    return replace(
        sound,
        accel_long=c * sound.accel_long + s * sound.accel_lat,
        accel_lat=c * sound.accel_lat - s * sound.accel_long,
    )


def banked(sound: Drive, share: float) -> Drive:
    """A road whose bank turns gravity into the bend: rotation about the car's long axis."""
    bank = np.arctan(share * sound.speed * sound.yaw_rate / GRAVITY)
    return replace(sound, accel_lat=sound.accel_lat * np.cos(bank) - GRAVITY * np.sin(bank))


def steered(sound: Drive, ratio: float, offset: float, understeer: float) -> Drive:
    """Wheels that point where a two-wheel car with an understeer gradient needs them to."""
    kappa = sound.yaw_rate / np.maximum(sound.speed, 0.1)
    wheels = np.arctan(SPEC.wheelbase_m * kappa) + understeer * sound.speed * sound.yaw_rate
    return replace(sound, steering_wheel=15.0 * ratio * wheels + offset)


@pytest.fixture(scope="module")
def sound() -> Drive:
    """A drive with sensors in order."""
    return drive(SPEC, SEED)


def test_sensors_in_order_have_no_finding(sound: Drive) -> None:
    """All errors are fitted, none is beyond the usual size."""
    reader = reader_of(recording_of(sound))

    assert {"accel_long", "accel_lat", "steering"} == set(rows_of(reader))
    assert [] == unusual([reader], 400.0, False)
    assert 0.0 == max(deviations_beyond(one, False) for one in fit_sensor_errors(reader))


def test_each_error_is_named_with_its_size(sound: Drive) -> None:
    """Of sensors that are off in one way each, the way and the size are told."""
    zero = replace(sound, accel_lat=sound.accel_lat + 0.4, accel_long=sound.accel_long - 0.4)
    wrong = [
        (zero, "accelerometer_bias", {"long_mps2": -0.4, "lat_mps2": 0.4}),
        (turned(sound, 0.09), "accelerometer_tilt", {"yaw_rad": 0.09}),
        (banked(sound, 0.25), "road_bank", {"bank_share": 0.25}),
        (steered(sound, 1.0, 0.1, 0.0), "steering_offset", {"offset_rad": 0.1}),
        (steered(sound, 1.2, 0.0, 0.0), "steering_ratio_error", {"ratio": 1.2}),
        (steered(sound, 1.0, 0.0, 8e-3), "compliance_steer", {"coefficient": 8e-3}),
    ]
    for changed, name, sizes in wrong:
        (finding,) = unusual([reader_of(recording_of(changed))], 400.0, False)

        assert name == finding.effect
        assert set(sizes) == set(finding.parameters)
        for parameter, size in sizes.items():
            quantity = finding.parameters[parameter]
            assert quantity.std is not None
            assert pytest.approx(size, abs=3.0 * quantity.std) == quantity.value


def test_what_reads_the_same_is_said(sound: Drive) -> None:
    """A constant to the left may be the sensor's zero, its mount or the road; one forward not the road."""
    left = replace(sound, accel_lat=sound.accel_lat + 0.5)
    forward = replace(sound, accel_long=sound.accel_long + 0.5)
    found = [unusual([reader_of(recording_of(one))], 400.0, False)[0] for one in (left, forward)]

    assert [("accelerometer_tilt", "road_bank"), ("accelerometer_tilt",)] == [
        one.indistinguishable_from for one in found
    ]
    assert ["accel_lat", "accel_long"] == [one.where.channel for one in found]


def test_a_report_can_say_where(sound: Drive) -> None:
    """Each of these sensors has its words in the summary."""
    off = replace(steered(sound, 1.0, 0.1, 0.0), accel_lat=sound.accel_lat + 0.5)
    recording = recording_of(replace(off, accel_long=sound.accel_long + 0.5))
    drifting = replace(recording, host_minus_utc_s=5e-4 * recording.fix_time_s)
    texts = [location_text(one.where) for one in unusual([reader_of(drifting)], 400.0, False)]

    assert 3 == len(texts)
    assert any(text.startswith("the host's clock against UTC") for text in texts)
    assert {*ROLES, CLOCK} <= set(CHANNELS)


@pytest.mark.parametrize(("rate", "named"), [(5e-4, ["clock_drift"]), (3e-5, [])])
def test_a_clock_is_identified_by_the_receivers_utc(sound: Drive, rate: float, named: list[str]) -> None:
    """500 ppm are a finding, a crystal's 30 ppm and a step are not."""
    recording = recording_of(sound)
    time_s = recording.fix_time_s
    late = np.random.default_rng(SEED).exponential(3e-3, len(time_s))
    off = rate * time_s + late + 2.0 * (time_s > 200.0)
    found = unusual([reader_of(replace(recording, host_minus_utc_s=off))], 400.0, False)

    assert named == [one.effect for one in found]
    for one in found:
        assert pytest.approx(rate, rel=0.1) == one.parameters["rate"].value
