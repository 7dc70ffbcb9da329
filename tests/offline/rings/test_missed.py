"""Counts that are lost while a wheel turns, told from a larger radius by the ring's ripple."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.offline.diagnosis.draw import draw_case
from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tests.car.physics.motions import car
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.diagnosis.assessment.lost_counts import missed_count_findings
from tpmsd.offline.diagnosis.hypotheses.plausible import counter_bounds, is_plausible
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.drives.drive import load
from tpmsd.offline.drives.playing import recording_of as read
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader
from tpmsd.offline.rings.missed import missed_counts, plausible_loss_rates

RL = WHEELS.index("rl")
COUNTS = 40_000.0


@cache
def _eccentric(deviation_m: float = 0.0, teeth: float = COUNTS, wheel: str = "rl") -> Recording:
    """Seven minutes with a ring 0.15 mm off centre on one wheel, whose tyre grows at half time."""
    physics: dict[str, dict[str, object]] = {
        "tone_ring_error": {"wheel": wheel, "amplitude_rad": 3e-3},
        "radius_change": {"wheel": "rl", "deviation_m": deviation_m, "onset_s": 200.0, "duration_s": 1.0},
    }
    return recording_of(
        drive(Spec(duration_s=420.0, road="motorway", teeth=teeth, physics=physics, radius_spread_m=0.0), 4)
    )


def _losing(recording: Recording, share: float, after_s: float = 0.0) -> Recording:
    rotation = recording.rotation_rad.copy()
    rotation[recording.edges_s[1:] > after_s, RL] *= 1.0 - share
    return dataclasses.replace(recording, rotation_rad=rotation)


@pytest.mark.parametrize(("after_s", "mean"), [(0.0, 2e-3), (200.0, 1.05e-3)])
def test_counts_lost_at_all_times_or_for_a_while_are_reported_with_their_share(
    after_s: float, mean: float
) -> None:
    """Two in a thousand, from the start or from half time on: wheel, mean share and rate are right."""
    recording = _losing(_eccentric(), 2e-3, after_s)
    (found,) = missed_counts(recording, reference(recording))
    counts_per_s = float(np.nanmean(recording.rotation_rad[:, RL])) / recording.dt_s / (2.0 * np.pi) * COUNTS

    assert "rl" == found.wheel
    assert found.share == pytest.approx(mean, abs=2e-4)
    assert found.share_std < 4e-4
    assert found.rate_per_s == pytest.approx(found.share * counts_per_s, rel=0.05)
    assert found.counts_per_rev == pytest.approx(COUNTS * (1.0 - found.share))


@pytest.mark.parametrize("deviation_m", [0.0, 6e-4])
def test_a_larger_radius_loses_no_counts(deviation_m: float) -> None:
    """A tyre that grows by two in a thousand for half of the drive turns less, and so does its ripple."""
    recording = _eccentric(deviation_m)

    assert [] == missed_counts(recording, reference(recording))


def test_two_wheels_that_miss_equally_have_another_ring() -> None:
    """Two in a thousand fewer on both wheels of an axle are the number of their rings' counts."""
    both = _eccentric(wheel="rr")
    rotation = both.rotation_rad * 0.998
    rotation[:, RL] = 0.998 * _eccentric().rotation_rad[:, RL]
    recording = dataclasses.replace(both, rotation_rad=rotation)

    assert [] == missed_counts(recording, reference(recording))


def test_what_comes_and_goes_with_bends_is_no_loss() -> None:
    """Three in a thousand fewer in left bends and as many more in right ones are none in the mean."""
    recording = _eccentric()
    turn = np.sign(np.diff(reference(recording).motion.heading_rad))
    rotation = recording.rotation_rad.copy()
    rotation[:, RL] *= 1.0 - 3e-3 * (turn - turn.mean())

    assert [] == missed_counts(dataclasses.replace(recording, rotation_rad=rotation), reference(recording))


def test_the_ripple_of_a_rear_ring_is_none_of_the_front_wheels(tmp_path: Path) -> None:
    """A rear ring that is far off centre moves the motion that the frames tell, and no front wheel loses."""
    case = draw_case("tone_ring_error", 2.0, 8)
    write_folder(drive(dataclasses.replace(case.spec, duration_s=420.0), case.world_seed), tmp_path)
    recording = read(load(tmp_path))

    assert [] == missed_counts(recording, reference(recording))


@pytest.mark.parametrize(("changed_m", "share"), [(0.0, 2e-3), (-1.5e-3, 0.0), (0.0, -2e-3)])
def test_the_ripple_limits_what_a_counter_may_lose_or_add(changed_m: float, share: float) -> None:
    """The true rate is possible; two counts of a thousand more or less are not, even as a radius changes."""
    recording = _losing(_eccentric(changed_m), share)
    low, high = plausible_loss_rates(recording, reference(recording), 12.5)["rl"]
    counts_per_s = float(np.nanmean(recording.rotation_rad[:, RL])) / recording.dt_s / (2.0 * np.pi) * COUNTS

    assert low < share * counts_per_s < high
    assert high - low < 2e-3 * counts_per_s
    bounds = counter_bounds([{"rl": (low, high)}])
    for effect, sign in (("counter_missed_pulses", 1.0), ("counter_extra_pulses", -1.0)):
        term = Term(effect, np.zeros((2, 1)), ("rate_per_s",), 3.5, pattern="rl")
        for offset, possible in ((0.0, True), (2e-3, False), (-2e-3, False)):
            value = sign * (share + offset) * counts_per_s
            assert possible == is_plausible(term, np.array([value]), bounds)


def test_coarse_rings_tell_nothing() -> None:
    """Of 48 teeth a usual ripple is far below a count."""
    recording = _losing(_eccentric(teeth=48.0), 2e-3)

    assert [] == missed_counts(recording, reference(recording))


def test_a_finding_names_its_drive_and_says_what_tells_it_from_a_radius() -> None:
    """Of two drives the one that loses counts is named; the sentence has the counts between two ripples."""
    whole = dataclasses.replace(_eccentric(), name="whole")
    losing = dataclasses.replace(_losing(_eccentric(), 2e-3), name="losing")
    regression = Regression([Reader(one, reference(one)) for one in (whole, losing)])
    (finding,) = missed_count_findings(regression, regression.driving_s)

    assert ("counter_missed_pulses", ("losing",), ("rl",)) == (
        finding.effect,
        finding.drives,
        finding.where.wheels,
    )
    assert finding.identified_by.startswith("the ring's ripple, once per revolution, comes every 399")
    assert finding.p_value is None
    assert finding.own_chance is not None
    assert finding.own_chance < 1e-5


def test_rates_are_limited_by_the_counts_that_a_car_makes() -> None:
    """A tenth of the pulses at 20 m/s: 48 a second of 48 teeth, and as many times more of an encoder."""
    effect = EFFECTS["counter_missed_pulses"]
    (_, most), (_, finest) = (
        effect.limits(car(teeth_per_rev=teeth))["rate_per_s"] for teeth in (48.0, 48.0 * 800.0)
    )

    assert most == pytest.approx(0.1 * 48.0 * 20.0 / (2.0 * np.pi * 0.316))
    assert finest == pytest.approx(800.0 * most)
    assert make_effect("counter_missed_pulses", wheel="rl", rate_per_s=1260.0)
