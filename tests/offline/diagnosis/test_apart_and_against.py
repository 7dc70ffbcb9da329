"""Findings that are looked for apart from the terms, and what a simulation lacks, against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tpmsd.offline.diagnosis.assessment import lost_counts
from tpmsd.offline.diagnosis.assessment import teeth as of_teeth
from tpmsd.offline.diagnosis.assessment.lost_counts import low_speed_loss_findings
from tpmsd.offline.diagnosis.assessment.simulated import (
    CommonEffect,
    Differences,
    drive_independent_key,
    floored_noise,
    widened_design,
)
from tpmsd.offline.diagnosis.assessment.teeth import ordinary_ring_note, tooth_findings
from tpmsd.offline.diagnosis.hypotheses.terms import ANY_CAR, Term
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.rings.low_speed import LowSpeedLosses
from tpmsd.offline.rings.uneven_teeth import Ripple

QUIET = Noise((1e-3,) * 4)
SECONDS = 600.0


def regression_of(
    count: int, simulation: bool = False, counts: tuple[float | None, ...] = (None,) * 4
) -> Any:
    """A regression's drives as far as counters are concerned: no wheel, rings of 48 teeth as configured."""
    recording = SimpleNamespace(wheels=[], counts_per_rev=counts, car=SimpleNamespace(teeth_per_rev=48.0))
    reference = SimpleNamespace(car=SimpleNamespace(radius_m=np.full(4, 0.3)))
    drives = [
        SimpleNamespace(
            names=[],
            number=number,
            reader=SimpleNamespace(
                recording=SimpleNamespace(**vars(recording), number=number), reference=reference
            ),
        )
        for number in range(count)
    ]
    return SimpleNamespace(
        drives=drives, examined=drives[:1] if simulation else drives, simulation=simulation
    )


def ripple(amplitude_rad: float, std_rad: float, gain: float = 50.0, phase_rad: float = 1.0) -> Ripple:
    """Of the right rear wheel."""
    return Ripple("rr", amplitude_rad, std_rad, phase_rad, 0.1, gain, 1.5, 1.0)


@pytest.fixture
def rings(monkeypatch: pytest.MonkeyPatch) -> dict[int, list[Ripple]]:
    """The ripples of each drive; no faintly miscounted ring."""
    by_drive: dict[int, list[Ripple]] = {}
    monkeypatch.setattr(of_teeth, "ripples", lambda recording, _: by_drive.get(recording.number, []))
    monkeypatch.setattr(of_teeth, "wheels_with_wrong_teeth", lambda recording, radii: [])
    return by_drive


CALIBRATION: Any = SimpleNamespace(values=np.zeros(0))


def test_rings_of_several_drives_are_one_by_their_weights(rings: dict[int, list[Ripple]]) -> None:
    """Amplitudes are averaged by inverse variance, gains add up, the phase is that of the first drive."""
    rings.update({0: [ripple(2e-3, 1e-4, 30.0, 0.5)], 1: [ripple(3e-3, 2e-4, 20.0, 2.0)]})

    (found,) = tooth_findings(regression_of(2), CALIBRATION, SECONDS)
    amplitude = found.parameters["amplitude_rad"]

    assert (4 * 2e-3 + 3e-3) / 5 == pytest.approx(amplitude.value)
    assert 1.0 / math.sqrt(1e-4**-2 + 2e-4**-2) == pytest.approx(amplitude.std)
    assert ("rr", 0.5) == (found.parameters["wheel"].value, found.parameters["phase_rad"].value)
    assert (50.0, 50.0 / SECONDS) == (found.gain, found.loglik_gain_per_s)
    assert ("rr",) == found.where.wheels


def test_a_ring_pays_for_the_drives_in_which_it_was_looked_for(rings: dict[int, list[Ripple]]) -> None:
    """The least gain grows by the logarithm of their number."""
    least = 0.5 * SETTINGS.counters.ripple_admit_nats
    rings[0] = [ripple(2e-3, 1e-4, least + 0.5 * math.log(3))]

    assert 1 == len(tooth_findings(regression_of(1), CALIBRATION, SECONDS))
    assert [] == tooth_findings(regression_of(3), CALIBRATION, SECONDS)


def test_a_ring_that_runs_out_no_more_than_rings_do_is_no_finding(rings: dict[int, list[Ripple]]) -> None:
    """Edge-timed speeds show runouts of hundredths of a millimetre; a tenth on a ring of 50 mm is told."""
    rings[0] = [ripple(2e-4, 3e-5)]
    (small,) = tooth_findings(regression_of(1), CALIBRATION, SECONDS)
    rings[0] = [ripple(2e-3, 3e-5)]
    (large,) = tooth_findings(regression_of(1), CALIBRATION, SECONDS)

    assert "ring of rr: uneven by 2.0e-04 +- 3.0e-05 rad" in ordinary_ring_note(small, speeds=True)
    assert "" == ordinary_ring_note(large, speeds=True)


def test_of_a_simulation_that_holds_the_ring_the_difference_is_left(rings: dict[int, list[Ripple]]) -> None:
    """A ring that both hold alike is no finding; of another size, the difference with both variances is."""
    rings.update({0: [ripple(2e-3, 3e-4)], 1: [ripple(2.1e-3, 4e-4)]})
    similar = tooth_findings(regression_of(2, simulation=True), CALIBRATION, SECONDS)
    rings[1] = [ripple(12e-3, 4e-4)]
    (other,) = tooth_findings(regression_of(2, simulation=True), CALIBRATION, SECONDS)
    rings[1] = []
    (lacking,) = tooth_findings(regression_of(2, simulation=True), CALIBRATION, SECONDS)

    assert [] == similar
    assert (-10e-3, 5e-4) == pytest.approx(
        (other.parameters["amplitude_rad"].value, other.parameters["amplitude_rad"].std)
    )
    assert 12e-3 == other.simulated["amplitude_rad"].value
    assert ("both", "recording") == (other.held_by, lacking.held_by)


@pytest.mark.parametrize(
    ("counts", "wheels"),
    [((44.0,) * 4, ("fl", "fr", "rl", "rr")), ((None, 44.0, None, None), ("fr",)), ((None,) * 4, None)],
)
def test_a_miscounted_ring_is_reported_of_its_wheel_or_of_all(
    rings: dict[int, list[Ripple]], counts: tuple[float | None, ...], wheels: tuple[str, ...] | None
) -> None:
    """All four alike are one finding of no wheel's name; a ring as configured is none."""
    found = tooth_findings(regression_of(1, counts=counts), CALIBRATION, SECONDS)

    assert ([] if wheels is None else [wheels]) == [one.where.wheels for one in found]
    assert all(44.0 == one.parameters["teeth_per_rev"].value for one in found)
    assert all(("wheel" in one.parameters) == (len(one.where.wheels) == 1) for one in found)


def test_counts_lost_at_walking_pace_are_identified_by_the_drive_that_tells_them_best(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its gain less what is asked of it is the log odds of the finding; drives that lose none say nothing."""
    asked = SETTINGS.counters.lost_admit_nats
    reported = [None, LowSpeedLosses(("rl",), 2.0, 0.1, 0.3, 0.02, asked + 2.0, (0.5, 2.0)), None]
    reported.append(LowSpeedLosses(("rl", "rr"), 2.2, 0.1, 0.3, 0.02, asked + 3.0, (0.5, 2.2)))
    monkeypatch.setattr(
        lost_counts, "low_speed_losses", lambda recording, radii_m: reported[recording.number]
    )

    (found,) = low_speed_loss_findings(regression_of(4), SECONDS)

    assert ("rl rr", 2.2) == (found.parameters["wheels"].value, found.parameters["below_mps"].value)
    assert math.log(found.confidence / (1.0 - found.confidence)) == pytest.approx(3.0)
    assert (0.5, 2.2) == found.where.range
    assert [] == low_speed_loss_findings(regression_of(1), SECONDS)


def test_a_quieter_simulation_is_believed_no_further_than_a_share_of_the_recording() -> None:
    """Its noise is raised to that share and then has the recording's memory; what is louder stays."""
    share = SETTINGS.assessment.simulation_floor
    recorded = replace(QUIET, speed_mps=0.1, speed_memory=0.7, slow_m=2.0, slow_tau_s=50.0)
    simulated = replace(
        QUIET, speed_mps=0.01 * share, speed_memory=0.1, slow_m=5.0, slow_tau_s=9.0, reading_m=(1e-9,) * 4
    )

    raised = floored_noise(simulated, recorded)

    assert (share * 0.1, 0.7) == (raised.speed_mps, raised.speed_memory)
    assert (5.0, 9.0) == (raised.slow_m, raised.slow_tau_s)
    assert (share * 1e-3,) * 4 == raised.reading_m
    assert recorded == floored_noise(recorded, recorded)


def test_what_both_hold_is_fitted_behind_the_calibration_and_differences_are_the_recordings() -> None:
    """The values of the second common effect begin behind those of the first."""

    def term(effect: str, width: int, drive: int | None = None) -> Term:
        names = tuple(f"p{k}" for k in range(width))
        return Term(effect, np.ones((20, width)), names, 0.0, drive=drive)

    common = [CommonEffect(term("longitudinal_slip", 2)), CommonEffect(term("centrifugal_growth", 1))]
    catalogue = [term("wear", 1, 0), term("wear", 1, 1), term("wear", 1)]
    joint: Any = SimpleNamespace(
        width=20,
        catalogue=catalogue,
        nuisance=np.zeros((20, 9)),
        splines_of=lambda drive: [term("unknown", 3, drive)],
        car=ANY_CAR,
    )

    hypotheses = Differences(joint, common)

    assert [9, 11] == [hypotheses.first_value_index(one) for one in common]
    assert (20, 12) == hypotheses.nuisance.shape
    assert [0] == [one.drive for one in hypotheses.catalogue]
    assert [0] == [one.drive for one in hypotheses.splines]
    assert drive_independent_key(catalogue[0]) == drive_independent_key(catalogue[2]) != common[0].key


def test_a_design_is_widened_by_columns_that_take_no_part() -> None:
    """Zeros at the end; what it was stays."""
    design = np.arange(6.0).reshape(3, 2)

    assert np.array_equal(np.concatenate([design, np.zeros((2, 2))]), widened_design(design, 5))
