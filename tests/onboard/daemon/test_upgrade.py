"""State and configuration of an earlier version are taken over.

These commits wrote the folders `upgrade_438989a` and `upgrade_03ed116` (version 0.1.0): a daemon on the
virtual bus, its simulated car with a puncture of the rear left tyre; the configuration is what `run --record`
wrote, with every key.
"""

from __future__ import annotations

import json
import logging
import shutil
from pathlib import Path
from typing import Any

import can
import cantools.database
import numpy as np
import pytest
from cantools.database.can import Database

from tests.conftest import REPO
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.main import main
from tpmsd.onboard.daemon.state_keeper import StateKeeper
from tpmsd.onboard.monitor.baseline.reference import AGE
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database

WRITTEN = [Path(__file__).parent / f"upgrade_{commit}" for commit in ("438989a", "03ed116")]
ALARMS = [("deflation", "rl"), ("radius_deviation", "rl")]
"""They stood when the old version was stopped."""
SUFFIXES = [f"_{wheel}" for wheel in WHEELS]
LOG = logging.getLogger("tests.upgrade")


@pytest.fixture(params=WRITTEN, ids=lambda folder: str(folder.name))
def config(request: pytest.FixtureRequest, tmp_path: Path) -> Config:
    """The configuration of a copy of the old folder."""
    return load_config(shutil.copytree(request.param, tmp_path / "car"))


def taken_up(config: Config) -> Pipeline:
    """The pipeline with which the daemon starts."""
    database = load_database(config.can.dbc)
    return StateKeeper(config, LOG).restored(lambda: Pipeline(config, database))


def saved_state(config: Config) -> dict[str, Any]:
    """The snapshot in the state file."""
    return dict(json.loads(Path(config.state.file or "").read_text())["payload"]["pipeline"])


def alarms(snapshot: dict[str, Any]) -> list[tuple[str, str | None]]:
    """Kind and wheel of each standing alarm, in order."""
    return sorted((alarm["kind"], alarm["wheel"]) for alarm in snapshot["monitor"]["alarms"])


def test_the_old_configuration_is_valid(config: Config, capsys: pytest.CaptureFixture[str]) -> None:
    """`check` has nothing against it."""
    code = main(["check", str(config.can.dbc.parent)])
    said = capsys.readouterr()

    assert (0, "") == (code, said.err)
    assert "vehicle.toml: nothing wrong in the file itself" in said.out


def test_the_old_state_is_taken_up(config: Config, caplog: pytest.LogCaptureFixture) -> None:
    """Radii, baseline and standing alarms are those that were saved; nothing is set aside."""
    caplog.set_level(logging.INFO)
    then, now = saved_state(config), taken_up(config).snapshot()

    assert [f"{config.state.file}: taken up what was learned before"] == caplog.messages
    assert ["bus.dbc", "state.json", "vehicle.toml"] == sorted(
        p.name for p in config.can.dbc.parent.iterdir()
    )
    np.testing.assert_allclose(now["estimator"]["mean_m"], then["estimator"]["mean_m"], rtol=1e-12)
    baseline, before = (one["monitor"]["sets"]["baseline"] for one in (now, then))
    mean = baseline["reference"]["mean"]
    learned = before["reference"]["mean"]
    if len(learned) == len(mean) - 1:  # 438989a learns no latency: as before the first drive
        learned = [*learned[:AGE], 0.03, *learned[AGE:]]
    assert learned == mean
    assert (True, before["learned_s"]) == (baseline["ready"], baseline["learned_s"])
    assert (ALARMS, ALARMS) == (alarms(then), alarms(now))


def test_what_was_taken_up_is_saved_and_taken_up_again(
    config: Config, caplog: pytest.LogCaptureFixture
) -> None:
    """The first save by this version loses none of it."""
    first = taken_up(config).snapshot()
    StateKeeper(config, LOG).save(0.0, first)
    second = taken_up(config).snapshot()

    assert [] == [record.message for record in caplog.records if record.levelno > logging.INFO]
    assert first["monitor"] == second["monitor"]


def test_the_daemon_starts_with_the_alarms_of_the_old_version(config: Config) -> None:
    """`run` reports the saved alarms in its first frame of alarms, and saves them."""
    channel = f"upgrade-{config.can.dbc.parent}"
    reports = cantools.database.load_file(str(REPO / "dbc" / "tpmsd.dbc"))
    assert isinstance(reports, Database)
    with can.Bus(interface="virtual", channel=channel) as bus:
        options = ["--config", str(config.can.dbc.parent), "--channel", channel, "--device", ""]
        code = main(["run", *options, "--speed-up", "10", "--duration", "5"])
        frames = list(iter(lambda: bus.recv(0.0), None))
    sent = [frame for frame in frames if frame is not None and frame.arbitration_id == config.alarms.alarm_id]
    alarm = reports.get_message_by_frame_id(config.alarms.alarm_id)
    decoded: Any = alarm.decode(bytes(sent[0].data), decode_choices=False)
    raised = {name for name, value in decoded.items() if name[-3:].lower() in SUFFIXES and value}

    assert (0, {"Deflation_RL", "RadiusDeviation_RL"}) == (code, raised)
    assert ALARMS == alarms(saved_state(config))
