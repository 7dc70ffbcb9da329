"""Wheels that slip for a span of time: named with axle and span, and apart from what lasts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import EFFECTS, EVENTS
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.reporting.down_weighted import down_weighted


@pytest.mark.parametrize(
    ("slip", "duration_s", "driven", "axle", "named"),
    [
        (0.012, 40.0, True, True, ["wheel_spin"]),
        (0.012, 40.0, False, True, []),
        (-0.05, 5.0, False, False, ["wheel_lock"]),
        (-0.005, 300.0, True, True, []),
        (-0.011, 300.0, True, True, ["chains"]),
        (-0.011, 300.0, True, False, []),
        (0.001, 40.0, True, True, []),
    ],
)
def test_what_may_be_an_event(
    slip: float, duration_s: float, driven: bool, axle: bool, named: list[str]
) -> None:
    """Only driven wheels spin, only whole axles bear chains; what is small or lasts for minutes is a
    change of the tyre or a warm brake."""
    assert named == [name for name in EVENTS if EFFECTS[name].fits_span(slip, duration_s, driven, axle)]


def test_both_wheels_of_an_axle_that_spin_on_ice_are_one_finding() -> None:
    """12 s at a slip of 0.8 % in a drive of seven minutes: axle, slip, onset and duration."""
    recording = recording_of(drive(Spec(duration_s=420.0, road="rural", driven="rear"), 8))
    times = recording.edges_s[:-1]
    spinning = (times >= 200.0) & (times < 212.0)
    factor = 1.0 + 0.008 * spinning[:, None] * np.array([0.0, 0.0, 1.0, 1.0])

    diagnosis = diagnose([replace(recording, rotation_rad=recording.rotation_rad * factor)])

    assert ["wheel_spin"] == [finding.effect for finding in diagnosis.findings]
    (finding,) = diagnosis.findings
    values = {name: quantity.value for name, quantity in finding.parameters.items()}
    assert "rl rr" == values["wheels"]
    assert ("rl", "rr") == finding.where.wheels
    assert pytest.approx(0.008, abs=4e-4) == values["slip"]
    assert pytest.approx(200.0, abs=1.5) == values["onset_s"]
    assert pytest.approx(12.0, abs=2.0) == values["duration_s"]
    ((begin, end),) = finding.where.time_spans
    assert pytest.approx((200.0, 212.0), abs=2.0) == (begin, end)


def test_a_strong_spin_between_the_knots_of_a_long_drive_is_no_noise() -> None:
    """1.2 % for 25 s of 20 min, nine seconds off the next knots: what the grid leaves is many millimetres."""
    recording = recording_of(drive(Spec(duration_s=1200.0, road="rural", driven="front"), 8))
    times = recording.edges_s[:-1]
    spinning = (times >= 300.0) & (times < 325.0)
    factor = 1.0 + 0.012 * spinning[:, None] * np.array([1.0, 1.0, 0.0, 0.0])

    (finding,) = diagnose([replace(recording, rotation_rad=recording.rotation_rad * factor)]).findings

    values = {name: quantity.value for name, quantity in finding.parameters.items()}
    assert ("wheel_spin", "fl fr") == (finding.effect, values["wheels"])
    assert pytest.approx((0.012, 300.0, 25.0), rel=0.02) == (
        values["slip"],
        values["onset_s"],
        values["duration_s"],
    )


def test_one_wheel_that_locks_for_a_while_has_a_name() -> None:
    """2 % for 15 s: the event, and no nonparametric term on the same span."""
    recording = recording_of(drive(Spec(duration_s=600.0, road="rural", driven="front"), 10))
    times = recording.edges_s[:-1]
    locking = (times >= 300.0) & (times < 315.0)
    factor = 1.0 - 0.02 * locking[:, None] * np.array([0.0, 0.0, 0.0, 1.0])

    findings = diagnose([replace(recording, rotation_rad=recording.rotation_rad * factor)]).findings

    assert [("wheel_lock", ("rr",))] == [(finding.effect, finding.where.wheels) for finding in findings]


def test_what_robust_weights_took_away_is_reported_with_its_place() -> None:
    """Readings of two blocks weigh a quarter: three quarters of a channel's data there, and their span."""
    drive = SimpleNamespace(
        reader=SimpleNamespace(
            windows=SimpleNamespace(
                measured=np.zeros((120, 9)), time_s=np.arange(120) + 0.5, __len__=lambda: 120
            )
        ),
        inflate=np.ones((120, 9)),
        blocks=np.arange(120) // 30,
    )
    drive.inflate[30:90] = 4.0

    reported = down_weighted([cast(DriveRegression, drive)])

    assert pytest.approx(0.375) == reported.share
    assert pytest.approx(0.375) == reported.by_channel["gnss_speed"]
    assert ((30.0, 90.0),) == reported.time_spans
