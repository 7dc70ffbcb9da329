"""Changes of a radius are told from radii that drift."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.interfaces.cli.diagnose import read_recording
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.robustness import change_or_drift
from tpmsd.offline.diagnosis.robustness.change_or_drift import add_radius_change, add_velocity_error
from tpmsd.offline.diagnosis.robustness.confirm import remove_terms_of_slow_noise
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.inference.noise_fit import VELOCITY, refit, refit_radius_drift
from tpmsd.offline.inference.recording import Recording

DRIFT, MEMORY_S = 1.2e-3, 20.0
"""Relative standard deviation of the radii's drift, as on real roads, and its time constant."""


def drifting(changed_m: float, last_m: float = 0.0) -> Recording:
    """A car whose radii drift; that of the left rear wheel changes within a minute, and in the last 15 s."""
    recording = recording_of(drive(Spec(duration_s=300.0, road="rural"), 6))
    rng = np.random.default_rng(6)
    kept = np.exp(-recording.dt_s / MEMORY_S)
    fresh = rng.normal(0.0, DRIFT * np.sqrt(1.0 - kept**2), recording.rotation_rad.shape)
    drift: FloatArray = lfilter([1.0], [1.0, -kept], fresh, axis=0)
    ramp = np.clip((recording.edges_s[:-1] - 100.0) / 60.0, 0.0, 1.0)
    last = recording.edges_s[1:] > recording.edges_s[-1] - 15.0
    change = (changed_m * ramp + last_m * last) / recording.car.radius_m[0]
    change = change[:, None] * (np.array(WHEELS) == "rl")
    return replace(recording, rotation_rad=recording.rotation_rad / (1.0 + drift + change))


def drift_alone(recording: Recording) -> FoundTerms:
    """A recording under the drift that is likeliest without a change, with nothing chosen."""
    readers, _ = admitted_readers([recording])
    regression = Regression(readers)
    car, windows = regression.drives[0], readers[0].windows
    plain = car.data_and_design(regression.hypotheses.nuisance)
    car.noise = refit_radius_drift(windows, plain, replace(car.noise, radius_drift=1e-3), None)
    return nothing_chosen(regression)


def nothing_chosen(regression: Regression) -> FoundTerms:
    """A regression with nothing chosen."""
    evidence = regression.evidence()
    return FoundTerms(
        regression, Selector(evidence, regression.hypotheses, last=True).selection_of([]), evidence
    )


@pytest.mark.parametrize(
    ("changed_m", "last_m", "wheels"), [(-3e-3, 0.0, ["rl"]), (0.0, 0.0, []), (-3e-3, 2e-3, ["rl"])]
)
def test_a_change_of_a_radius_is_distinguished_from_drift(
    changed_m: float, last_m: float, wheels: list[str]
) -> None:
    """Beside the drift that is likeliest without it, it is nothing unusual; two accounts as wholes differ.

    What one block at the end shows does not hide it.
    """
    alone = drift_alone(drifting(changed_m, last_m))

    found = add_radius_change(alone, alone.selection)

    assert wheels == [one.term.wheel for one in found.selection.chosen]
    assert () == remove_terms_of_slow_noise(found).selection.chosen


def test_a_change_that_was_chosen_earlier_is_asked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is added with its own values, where the grid of changes offers none that is as likely."""
    alone = drift_alone(drifting(-3e-3))
    first = add_radius_change(alone, alone.selection)
    alone = nothing_chosen(first.regression.with_noise({0: alone.regression.drives[0].noise}))
    monkeypatch.setattr(change_or_drift, "_likeliest_change", lambda regression, terms, drifting: None)

    again = add_radius_change(alone, first.selection).selection
    none = add_radius_change(alone, alone.selection).selection

    assert [one.term.key for one in again.chosen] == [one.term.key for one in first.selection.chosen] != []
    assert none.chosen == ()


def test_a_set_gains_the_terms_that_its_change_goes_with_and_loses_those_it_does_not() -> None:
    """From the change and a lever arm that nobody has, to the change and the age of fixes that are late."""
    late = drifting(-3e-3)
    late = replace(late, fix_time_s=late.fix_time_s + 0.3)
    alone = drift_alone(late)
    regression = alone.regression
    gram, b = alone.evidence.projected(regression.hypotheses.nuisance)
    _, change = max(
        (entry for entry in regression.hypotheses.ramp_gains(gram, b) if entry[1].wheel == "rl"),
        key=lambda entry: entry[0],
    )
    lever_arm = next(term for term in regression.hypotheses.catalogue if term.effect == "antenna_lever_arm")
    selector = Selector(alone.evidence, regression.hypotheses, last=True)

    effects = {term.effect for term in change_or_drift._stepwise_best_set(selector, [change, lever_arm], [])}

    assert {"radius_change", "gnss_latency"} <= effects
    assert "antenna_lever_arm" not in effects


def test_what_other_terms_of_a_set_bring_is_no_merit_of_its_change() -> None:
    """A set of a change that is none and the age of late fixes scores high, by the age alone: it is left."""
    late = drifting(0.0)
    alone = drift_alone(replace(late, fix_time_s=late.fix_time_s + 0.3))
    hypotheses = alone.regression.hypotheses
    gram, b = alone.evidence.projected(hypotheses.nuisance)
    change = hypotheses.ramp_gains(gram, b)[0][1]
    age = next(term for term in hypotheses.catalogue if term.effect == "gnss_latency")
    models = change_or_drift._WholeModels(alone.regression)

    assert models.score([change, age]) > models.score([])
    assert (models, []) == change_or_drift._likeliest_set(models, [[change, age]], [], [])


@pytest.mark.parametrize(
    ("change_mm", "onset_s", "duration_s"), [(3.92, 101.0, 120.0), (3.01, 129.0, 0.0)], ids=["slow", "fast"]
)
def test_a_loss_on_a_mountain_road_is_found_together_with_the_slope(
    recordings: Path, tmp_path: Path, change_mm: float, onset_s: float, duration_s: float
) -> None:
    """Without the slope the radii drift so far that the loss is nothing unusual, and without the loss, too:
    one after the other neither was found, and the axle was said to be braked for two minutes."""
    out = tmp_path / "out"
    onto = str(recordings / "van-mountain-a")
    course = f"deviation_m={-1e-3 * change_mm},onset_s={onset_s},duration_s={duration_s}"
    assert 0 == main(["simulate", str(out), "--onto", onto, "--effect", f"radius_change:wheel=rr,{course}"])

    found = {one.effect: one for one in diagnose([read_recording(out)]).findings}

    assert {"radius_change", "gnss_latency", "road_grade"} == set(found)
    assert "rr" == found["radius_change"].parameters["wheel"].value
    deviation = found["radius_change"].parameters["deviation_m"]
    assert deviation.std is not None
    assert abs(1e3 * float(deviation.value) + change_mm) < 2e3 * float(deviation.std)


SPEED_STD_MPS, SPEED_MEMORY = 0.02, 0.95
"""Slow error of a receiver's speed, and its correlation from second to second."""


def along_a_motorway(north_mps: float) -> Recording:
    """A receiver whose speed errs slowly, and whose velocity is off to the north."""
    recording = recording_of(drive(Spec(duration_s=400.0, road="motorway", hilly=0.0), 7))
    rng = np.random.default_rng(8)
    times = recording.fix_time_s
    fresh = rng.normal(0.0, SPEED_STD_MPS * np.sqrt(1.0 - SPEED_MEMORY**2), int(times[-1]) + 2)
    slow: FloatArray = lfilter([1.0], [1.0, -SPEED_MEMORY], fresh)
    speed = recording.speed_mps + np.interp(times, np.arange(len(slow)), slow)
    shown = speed * np.exp(1j * recording.course_rad) + 1j * north_mps
    return replace(recording, speed_mps=np.abs(shown), course_rad=np.angle(shown))


@pytest.mark.parametrize("north_mps", [0.0, 0.05])
def test_a_constant_velocity_error_is_distinguished_from_slow_noise_of_the_speed(north_mps: float) -> None:
    """The noise estimated without it holds a part of it: under its own noise it brings half as much again."""
    readers, _ = admitted_readers([along_a_motorway(north_mps)])
    regression = Regression(readers)
    car, windows = regression.drives[0], readers[0].windows
    car.noise = refit(windows, car.data_and_design(regression.hypotheses.nuisance), car.noise, None, VELOCITY)
    evidence = regression.evidence()
    selector = Selector(evidence, regression.hypotheses, last=True)

    found = add_velocity_error(FoundTerms(regression, selector.selection_of([]), evidence)).selection.chosen

    assert (["doppler_heading_error"] if north_mps else []) == [one.term.effect for one in found]
    for one in found:
        north = float(one.values[one.term.parameters.index("north_mps")])
        assert north == pytest.approx(north_mps, abs=2.5 * float(one.stds.max()))
        assert one.gain > 1.5 * (selector.gain([one.term]) - selector.gain([]))


def test_a_small_velocity_error_is_found_by_the_whole_diagnosis() -> None:
    """0.025 m/s is no finding under the noise that was estimated without it, and one under its own."""
    (found,) = diagnose([along_a_motorway(0.025)]).findings

    assert "doppler_heading_error" == found.effect
    assert found.confidence > 0.9
