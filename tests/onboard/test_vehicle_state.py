"""The vehicle state in the core: live as in a replay, in the status, nothing where it is not asked for."""

from __future__ import annotations

import dataclasses
import logging
import subprocess
import sys
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from tests.onboard.daemon.fakes import FakeBus
from tests.onboard.daemon.test_live_is_replay import fed
from tpmsd.car.config.dynamics_record import DynamicsConfig
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config, VehicleStateConfig
from tpmsd.car.vehicle_state.record import VehicleState
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.schemas import schema_of
from tpmsd.interfaces.cli.status_table import render_status
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.daemon.bus_link import BusLink
from tpmsd.onboard.daemon.health import Health
from tpmsd.onboard.daemon.input_queue import InputQueue
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import FolderStream, Sentence

LOG = logging.getLogger("tests.vehicle_state")
Items = list[CanFrame | Sentence]


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Config, Items]:
    """A short simulated drive, and its car with masses, tyres and a filter of the state."""
    folder = tmp_path_factory.mktemp("state")
    write_drive(folder, simulate_drive(DriveSpec(duration_s=25.0, seed=2)))
    config = load_config(folder)
    return dataclasses.replace(
        config,
        filter=dataclasses.replace(config.filter, particles=10),
        dynamics=DynamicsConfig(1500.0, 2500.0, 1.2, 1.5, 0.5, 110e3, 130e3),
        vehicle_state=VehicleStateConfig("arupf", 30),
    ), list(FolderStream(folder))


def test_updating_the_time_changes_no_state(played: tuple[Config, Items]) -> None:
    """The daemon, which is told the time between inputs, has the very states of the replay."""
    config, items = played
    replayed = fed(config, items, [])
    live = fed(config, items, (0.05 + 0.13 * np.arange(190)).tolist())
    states = [step.vehicle_state for step in replayed]
    assert states == [step.vehicle_state for step in live]
    assert sum(state is not None for state in states) > 100


def test_the_radii_are_not_touched(played: tuple[Config, Items]) -> None:
    """With and without the filter of the state the radius filter draws and finds the same."""
    config, items = played
    without = dataclasses.replace(config, vehicle_state=VehicleStateConfig())
    one, other = (fed(each, items, [])[-1] for each in (config, without))
    assert np.array_equal(one.estimate.deviation_m, other.estimate.deviation_m, equal_nan=True)
    assert other.vehicle_state is None


def test_the_status_has_the_last_state(played: tuple[Config, Items]) -> None:
    """Method and numbers under `vehicle_state`, as the schema says; no such key without a method."""
    config, items = played
    bus = FakeBus()
    documents = []
    for each in (config, dataclasses.replace(config, vehicle_state=VehicleStateConfig())):
        link = BusLink(lambda: bus.opener()(config.can, None, "fake"), "CAN fake", LOG)
        health = Health(each, link, None, InputQueue(), 0.0)
        pipeline = Pipeline(each, load_database(each.can.dbc))
        documents.append(health.document(pipeline, 0.0, 0).get("vehicle_state"))
        steps = fed(each, items, [])
        last = next(k for k in range(len(steps) - 1, 0, -1) if steps[k].vehicle_state or each is not config)
        health.note_steps(steps[: last + 1], pipeline, 1.0)
        documents.append(health.document(pipeline, 1.0, 0).get("vehicle_state"))
    before, known, *without = documents
    assert before == {"method": "arupf", **dict.fromkeys(VehicleState._fields)}
    assert known is not None and known["velocity_long_mps"] > 2.0 and known["side_slip_std_rad"] > 0.0
    assert without == [None, None]
    jsonschema.validate(known, schema_of("tpmsd.status/2")["properties"]["vehicle_state"])
    assert "state     not known now (arupf)\n" in render_status({"vehicle_state": before})
    slip = f"side slip {known['side_slip_rad']:+.3f} +- {known['side_slip_std_rad']:.3f} rad"
    assert f"state     {slip}, lateral speed " in render_status({"vehicle_state": known})
    assert "side slip" not in render_status({})


def test_a_car_that_is_not_known_enough_is_refused(played: tuple[Config, Items]) -> None:
    """Whoever makes a pipeline with a method and without `[dynamics]` is told so."""
    config = dataclasses.replace(played[0], dynamics=DynamicsConfig())
    with pytest.raises(ConfigError, match=r"\[dynamics\] mass_kg"):
        Pipeline(config, load_database(config.can.dbc))


def test_without_a_method_no_filter_is_loaded() -> None:
    """The daemon's modules bring none of the filters: their memory is for those who ask."""
    code = (
        "import sys, tpmsd.onboard.daemon.loop, tpmsd.interfaces.cli.replay\n"
        "print([name for name in sys.modules if name.startswith('tpmsd.car.vehicle_state.')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    for name in ("estimator", "kalman", "particle", "unscented", "model"):
        assert f"'tpmsd.car.vehicle_state.{name}'" not in done.stdout
