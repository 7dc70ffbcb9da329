"""With the resonance as evidence a live run still is its replay, from frames to what the monitor hears."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.onboard.daemon.fakes import car
from tests.onboard.resonance.test_watch import RADIUS_M, RATE_HZ, drive, readings
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.build import monitored_wheels
from tpmsd.onboard.estimators.gates.agreement import Agreement
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.records import MonitorReport
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.resonance.evidence import ResonanceEvidence
from tpmsd.onboard.resonance.watch import ResonanceWatch
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.timeline.tick import Tick

START_S = 1_700_000_000.075
"""So that what is known changes with the very frame that completes a tick in the replay, while live the time
told before it has completed the tick already."""
STEP_KMH = 0.002
FRAME_ID = 176


class Listening(Monitor):
    """A monitor that keeps what it heard with each tick."""

    received: list[tuple[float, ResonanceEvidence | None]]

    def update(
        self,
        tick: Tick,
        estimate: RadiusEstimate,
        resonance: ResonanceEvidence | None = None,
        *more: Agreement,
    ) -> MonitorReport:
        """As the monitor."""
        self.received.append((tick.time_s, resonance))
        return super().update(tick, estimate, resonance, *more)


@pytest.fixture(scope="module")
def listening(tmp_path_factory: pytest.TempPathFactory) -> Config:
    """A car whose bus sends four fine speeds a hundred times a second, and whose resonances are heard."""
    folder = tmp_path_factory.mktemp("resonance")
    car(folder, "[monitor]\nresonance = true\n")
    dbc, vehicle = folder / "bus.dbc", folder / "vehicle.toml"
    dbc.write_text(dbc.read_text("utf-8").replace("(1,0)", f"({STEP_KMH},0)"), encoding="utf-8")
    text = vehicle.read_text("utf-8").replace("wheel_count_", "wheel_speed_")
    vehicle.write_text(text.replace("teeth_per_rev = 48\n", ""), encoding="utf-8")
    return load_config(folder)


def frames(speeds_radps: np.ndarray) -> list[tuple[float, bytes]]:
    """Stamped frames of (4, n) wheel speeds."""
    raw = np.round(speeds_radps * RADIUS_M[0] * 3.6 / STEP_KMH).astype("<u2")
    return [(START_S + k / RATE_HZ, column.tobytes()) for k, column in enumerate(raw.T.copy())]


def received(
    config: Config, sent: list[tuple[float, bytes]], learned: ResonanceWatch, late_s: float
) -> list[tuple[float, ResonanceEvidence | None]]:
    """What the monitor hears with each tick; `late_s`: the daemon tells the time this long after a frame, as
    it does when the bus pauses; 0: it never does, as in a replay."""
    pipeline = Pipeline(config, load_database(config.can.dbc))
    pipeline.restore({**pipeline.snapshot(), "resonance": learned.snapshot()})
    monitor = Listening(config.vehicle, config.monitor, monitored_wheels(config), config.tyre)
    monitor.received = []
    pipeline.monitor = monitor
    for time_s, data in sent:
        pipeline.on_frame(time_s, FRAME_ID, False, data)
        if late_s > 0.0:
            pipeline.advance(time_s + late_s)
    pipeline.finish()
    return monitor.received


def test_the_monitor_receives_the_same_live_and_in_the_replay(listening: Config) -> None:
    """However often the time is told, each tick hears the same evidence, and at the end it is not silent."""
    hertz = (36.0, 37.0, 35.0, 36.5)
    learned = ResonanceWatch(RADIUS_M)
    drive(learned, readings(1, 360.0, hertz), 0.0)
    sent = frames(readings(2, 80.0, (hertz[0] * 0.92, *hertz[1:])))
    config = dataclasses.replace(listening, filter=dataclasses.replace(listening.filter, particles=2))
    replayed = received(config, sent, learned, 0.0)
    live = received(config, sent, learned, 0.009)

    assert replayed == live
    evidence = replayed[-1][1]
    assert evidence is not None
    assert (0, 1, 2, 3) == evidence.wheels
    assert 0.0 < evidence.wheel_llr(0)
