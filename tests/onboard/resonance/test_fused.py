"""The resonance as evidence in the monitor: added by probability, and only if asked for."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from tests.onboard.monitor.drives import ALL, VEHICLE, Player
from tests.onboard.resonance.test_watch import RADIUS_M, drive, readings
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import MonitorConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.evidence.hypotheses import Comparison, Verdict, subsets
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.records import MonitorReport
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.resonance.evidence import ResonanceEvidence
from tpmsd.onboard.resonance.watch import ResonanceWatch
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.events import RotationSample
from tpmsd.onboard.timeline.tick import Tick

RL_SOFT = ResonanceEvidence((0, 1, 2, 3), {one: 4.0 * ((2,) == one) for one in [(), *subsets(4)]})
"""A resonance that speaks for the rear left wheel alone, with e^4 to 1."""


def of_one_wheel(log_ratios: FloatArray | None) -> Verdict:
    """Of a wheel of 0.3 m that is 1.2 +- 0.2 mm smaller, with the resonance beside the radii."""
    comparison = Comparison(np.array([0.3]), 0.0025, log_ratios)
    return comparison.compare(np.array([-0.0012]), np.array([[4e-8]]))


def test_a_log_ratio_is_added_to_the_odds_of_the_radii() -> None:
    """For one wheel the odds of a loss rise by just the ratio, and so does the share beyond the threshold."""
    alone, together = of_one_wheel(None), of_one_wheel(np.array([1.5]))
    odds = [(1.0 - verdict.none) / verdict.none for verdict in (alone, together)]

    assert math.exp(1.5) == pytest.approx(odds[1] / odds[0])
    shares = [verdict.deflated[0] / (1.0 - verdict.none) for verdict in (alone, together)]
    assert shares[0] == pytest.approx(shares[1])
    assert alone.suspicion == together.suspicion


def test_ratios_of_one_change_nothing() -> None:
    """Evidence that speaks for nobody leaves the verdict as it is."""
    alone, together = of_one_wheel(None), of_one_wheel(np.zeros(1))

    assert alone.none == together.none
    assert alone.deflated.tolist() == together.deflated.tolist()


class _Hearing(Monitor):
    """A monitor with the resonance beside the radii."""

    received: ResonanceEvidence | None = None

    def update(
        self, tick: Tick, estimate: RadiusEstimate, resonance: ResonanceEvidence | None = None
    ) -> MonitorReport:
        """As the monitor, with this resonance."""
        return super().update(tick, estimate, self.received)


def _probabilities(evidence: ResonanceEvidence | None, change: float) -> list[float]:
    """Probabilities of deflation after the rear left radius changed by a share for 8 s."""
    hearing = _Hearing(VEHICLE, MonitorConfig(), ALL)
    player = Player(hearing)
    player.play(200.0)
    hearing.received = evidence
    player.play(8.0, (0.0, 0.0, change, 0.0))
    return [wheel.deflation_probability for wheel in player.reports[-1].wheels]


def test_the_monitor_receives_the_resonance() -> None:
    """A doubtful loss of radius is likelier if the wheel's resonance fell, and no other wheel's is."""
    alone, received = (_probabilities(evidence, -0.0018) for evidence in (None, RL_SOFT))

    assert 1e-4 < alone[2] < 0.9
    assert received[2] > alone[2]
    assert all(received[wheel] <= alone[wheel] + 1e-9 for wheel in (0, 1, 3))


def test_the_resonance_alone_is_no_alarm() -> None:
    """Where the radii say that all is well, a resonance does not make a deflation probable."""
    assert max(_probabilities(RL_SOFT, 0.0)) < 0.5


def test_a_silent_resonance_changes_no_bit() -> None:
    """Off is off."""
    assert _probabilities(None, -0.003) == _probabilities(ResonanceEvidence.silent(), -0.003)


def test_it_is_not_received_unless_asked_for() -> None:
    """The default configuration leaves the alarms to the radii."""
    assert not MonitorConfig().resonance


class _Between:
    """Passes on the samples with stamps in [begin, end)."""

    def __init__(self, watch: ResonanceWatch, begin_s: float, end_s: float) -> None:
        self._watch, self._begin_s, self._end_s = watch, begin_s, end_s

    def add(self, sample: RotationSample) -> None:
        """Pass on or drop."""
        if self._begin_s <= sample.time_s < self._end_s:
            self._watch.add(sample)


def test_what_was_known_at_an_instant_does_not_change_with_later_samples() -> None:
    """Asked for the same instants, a watch that has seen more says the same: live is replay."""
    learning = ResonanceWatch(RADIUS_M)
    drive(learning, readings(1, 380.0, (36.0, 37.0)), 0.0)
    speeds = readings(2, 150.0, (36.0, 34.0))
    late, soon = ResonanceWatch(RADIUS_M), ResonanceWatch(RADIUS_M)
    for watch in (late, soon):
        watch.restore(learning.snapshot())
    instants = [40.0, 70.0, 75.0, 110.0, 149.0]
    drive(late, speeds, 0.0)
    at_end = [late.evidence_at(instant) for instant in instants]
    at_once = []
    for begin_s, instant in zip([0.0, *instants], instants, strict=False):
        drive(_Between(soon, begin_s, instant), speeds, 0.0)
        at_once.append(soon.evidence_at(instant))

    assert at_end == at_once
    assert ResonanceEvidence.silent() == at_once[0]
    assert (0, 1) == at_once[-1].wheels


def test_the_pipeline_keeps_what_was_learned_if_it_listens(tmp_path: Path) -> None:
    """With `[monitor] resonance` the state has the baselines; without them saved they are learned again."""
    write_drive(tmp_path, simulate_drive(DriveSpec(duration_s=12.0, seed=1)))
    config = load_config(tmp_path)
    database = load_database(config.can.dbc)
    listening = dataclasses.replace(config, monitor=dataclasses.replace(config.monitor, resonance=True))
    deaf, hearing = Pipeline(config, database), Pipeline(listening, database)
    learning = ResonanceWatch(RADIUS_M)
    drive(learning, readings(1, 380.0, (36.0,)), 0.0)

    assert deaf.resonance is None
    assert "resonance" not in deaf.snapshot()
    hearing.restore({**hearing.snapshot(), "resonance": learning.snapshot()})
    assert learning.snapshot() == hearing.snapshot()["resonance"]
    hearing.restore(deaf.snapshot())
    assert not hearing.snapshot()["resonance"]["fl"]["baselines"]
