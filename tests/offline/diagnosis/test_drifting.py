"""A gyro that warms is told from one whose bias is constant, and from one that walks as gyros do."""

from __future__ import annotations

import numpy as np
import pytest

from bench.worlds import mems_gyro
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis import stages as whole
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.settings import SETTINGS

WARMING = {"strange_gyro_warming": {"size_radps": 0.002, "warming_s": 211.0}}
CONSTANT = {"yaw_rate_bias": {"bias": 0.002}}


def test_a_gyro_that_warms_has_no_constant_bias(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its walk was estimated so fast that only a constant was left of it, named with confidence 1."""
    recording = recording_of(drive(Spec(duration_s=650.0, road="rural", physics=WARMING), 4))
    findings = diagnose([recording]).findings
    monkeypatch.setattr(whole, "add_gyro_drift", lambda found: found)
    without = diagnose([recording]).findings

    assert [("unknown", "yaw_rate")] == [(one.effect, one.where.channel) for one in findings]
    assert findings[0].confidence > 0.9
    assert ["yaw_rate_bias"] == [one.effect for one in without]


def test_a_constant_bias_keeps_its_name() -> None:
    """2 mrad/s, as far as the other goes."""
    recording = recording_of(drive(Spec(duration_s=650.0, road="rural", physics=CONSTANT), 4))

    assert ["yaw_rate_bias"] == [finding.effect for finding in diagnose([recording]).findings]


@pytest.mark.parametrize("seed", [4, 5])
def test_a_gyro_that_walks_a_little_faster_than_usual_is_no_finding(seed: int) -> None:
    """0.2 mrad/s in ten minutes."""
    spec = Spec(duration_s=650.0, road="rural", gyro_drift=8e-6)

    assert () == diagnose([recording_of(drive(spec, seed))]).findings


def test_the_bias_instability_of_data_sheets_stays_below_the_limit() -> None:
    """Ranges of means over the splines' intervals of ten minutes, by the noise model of IEEE Std 952."""
    per = 600 // (SETTINGS.hypotheses.time_intervals + 1)
    ranges = []
    for seed in range(300):
        rng = np.random.default_rng([seed, 99])
        rate = mems_gyro.draw(rng).drawn(600, 1.0, rng)
        ranges.append(float(np.ptp(rate[: len(rate) // per * per].reshape(-1, per).mean(axis=1))))

    assert np.quantile(ranges, 0.98) < SETTINGS.robustness.gyro_far_radps
    assert SETTINGS.robustness.gyro_far_radps < 0.75 * WARMING["strange_gyro_warming"]["size_radps"]
