"""The diagnosis on drives of a world written apart from the catalogue."""

from __future__ import annotations

import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.assessment.result import Finding, RollingDiagnosis
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.inference.recording import Recording


def diagnosed(seed: int, duration_s: float = 700.0, **physics: dict[str, object]) -> RollingDiagnosis:
    """The diagnosis of a drive that conceals this physics."""
    return diagnose([recording_of(drive(Spec(duration_s=duration_s, physics=physics), seed))])


def only(diagnosis: RollingDiagnosis) -> Finding:
    """Its only finding."""
    assert 1 == len(diagnosis.findings), [finding.effect for finding in diagnosis.findings]
    return diagnosis.findings[0]


def test_a_drive_with_nothing_missing_is_consistent() -> None:
    """No finding where the car only rolls, although its radii differ from the nominal ones."""
    diagnosis = diagnosed(11)

    assert ("consistent", (), None) == (diagnosis.verdict, diagnosis.findings, diagnosis.unexplained)


def test_a_ring_that_is_uneven_as_rings_are_makes_no_mismatch() -> None:
    """On an encoder of 1,000 counts 0.02 mm off centre shows: it is said, and the drive is consistent."""
    ring = {"wheel": "fr", "amplitude_rad": 4e-4, "phase_rad": 0.5}
    spec = Spec(
        duration_s=360.0, road="city", teeth=1000, edge_noise_rad=1e-5, physics={"tone_ring_error": ring}
    )
    diagnosis = diagnose([recording_of(drive(spec, 7))])
    (note,) = diagnosis.notes

    assert ("consistent", ()) == (diagnosis.verdict, diagnosis.findings)
    assert note.startswith("the ring of fr: uneven by ")


@pytest.mark.parametrize(
    ("effect", "truth"),
    [
        ("load_transfer_longitudinal", {"coefficient": 6e-5}),
        ("load_transfer_lateral", {"coefficient": 1e-4}),
        ("longitudinal_slip", {"slip_per_accel": 2e-3, "slip_per_speed2": 5e-7}),
        ("yaw_rate_bias", {"bias": 1e-3}),
        ("gnss_latency", {"latency_s": 0.12}),
    ],
)
def test_an_effect_is_named_and_measured(effect: str, truth: dict[str, object]) -> None:
    """The name comes first and alone, and each parameter lies within four standard deviations."""
    finding = only(diagnosed(12, **{effect: truth}))

    assert effect == finding.effect
    for name, value in truth.items():
        quantity = finding.parameters[name]
        assert isinstance(quantity.value, float)
        assert quantity.std is not None
        assert abs(quantity.value - value) < 4 * quantity.std  # type: ignore[operator]


def test_a_leak_is_a_change_of_radius() -> None:
    """Wheel, size, onset and duration of a slow loss are found."""
    truth = {"wheel": "rl", "deviation_m": -1.4e-3, "onset_s": 250.0, "duration_s": 120.0}
    finding = only(diagnosed(13, radius_change=truth))
    values = {name: quantity.value for name, quantity in finding.parameters.items()}

    assert ("radius_change", "rl") == (finding.effect, values["wheel"])
    assert values["deviation_m"] == pytest.approx(-1.4e-3, rel=0.03)
    assert values["onset_s"] == pytest.approx(250.0, abs=8.0)
    assert values["duration_s"] == pytest.approx(120.0, abs=15.0)
    assert finding.where.time_spans[0] == pytest.approx((250.0, 700.0), abs=8.0)


def test_two_tyres_that_change_equally_are_one_finding() -> None:
    """Both rear tyres lose a millimetre in the same minute: one change, of both wheels."""
    truth = {"deviation_m": -1e-3, "onset_s": 300.0, "duration_s": 60.0}
    both = {"radius_change": {"wheel": "rl", **truth}, "radius_change_2": {"wheel": "rr", **truth}}
    finding = only(diagnosed(13, **both))
    values = {name: quantity.value for name, quantity in finding.parameters.items()}

    assert ("radius_change", ("rl", "rr")) == (finding.effect, finding.where.wheels)
    assert {"wheels", "deviation_m", "onset_s", "duration_s"} == set(values)
    assert "rl rr" == values["wheels"]
    assert values["deviation_m"] == pytest.approx(-1e-3, rel=0.05)
    assert values["onset_s"] == pytest.approx(300.0, abs=8.0)


def test_physics_of_no_catalogue_is_unknown_and_located() -> None:
    """A rear axle that shrinks around 20 m/s is located, and gets no wrong name."""
    dip = {"at_mps": 20.0, "width_mps": 3.0, "wheels": [2, 3], "size_m": -1.4e-3}
    finding = only(diagnosed(14, strange_speed_hump=dip))

    assert ("unknown", ("rl", "rr"), "speed") == (
        finding.effect,
        finding.where.wheels,
        finding.where.covariate,
    )


def test_uneven_teeth_are_found_between_the_counts() -> None:
    """A once-per-turn error of a tenth of a tooth is found with its size."""
    finding = only(diagnosed(15, tone_ring_error={"wheel": "fr", "amplitude_rad": 0.015}))

    assert ("tone_ring_error", "fr") == (finding.effect, finding.parameters["wheel"].value)
    assert finding.parameters["amplitude_rad"].value == pytest.approx(0.015, abs=0.004)


def test_a_drive_too_short_is_not_judged() -> None:
    """A minute of driving is insufficient, and the reason is said."""
    diagnosis = diagnosed(16, duration_s=60.0)

    assert ("insufficient_data", "the drive is shorter than 90 s") == (diagnosis.verdict, diagnosis.reason)


def test_a_drive_without_its_rear_wheels_is_not_judged() -> None:
    """The motion cannot be told without them."""
    recording = recording_of(drive(Spec(duration_s=200.0), 17))
    rotation = recording.rotation_rad.copy()
    rotation[:, 2:] = float("nan")
    blind = Recording(**{**vars(recording), "rotation_rad": rotation})

    assert "the rear wheels are not both read" == diagnose([blind]).reason
