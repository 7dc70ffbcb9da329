"""State and configuration of an earlier version are taken over.

`upgrade_438989a` was written by commit 438989a: a daemon on the virtual bus, its simulated car with a
puncture of the rear left tyre; the configuration is what `run --record` wrote, with every key.
"""

from __future__ import annotations

import json
import logging
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.interfaces.cli.main import main
from tpmsd.onboard.daemon.state_keeper import StateKeeper
from tpmsd.onboard.monitor.baseline.reference import AGE
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database

WRITTEN = Path(__file__).parent / "upgrade_438989a"
LOG = logging.getLogger("tests.upgrade")


@pytest.fixture
def config(tmp_path: Path) -> Config:
    """Of the old folder, copied."""
    return load_config(shutil.copytree(WRITTEN, tmp_path / "car"))


def taken_up(config: Config) -> Pipeline:
    """The pipeline with which the daemon starts."""
    database = load_database(config.can.dbc)
    return StateKeeper(config, LOG).restored(lambda: Pipeline(config, database))


def old_state() -> dict[str, Any]:
    """The snapshot as it was written."""
    return dict(json.loads((WRITTEN / "state.json").read_text())["payload"]["pipeline"])


def test_the_old_configuration_is_valid(config: Config, capsys: pytest.CaptureFixture[str]) -> None:
    """`check` has nothing against it."""
    code = main(["check", str(config.can.dbc.parent)])
    said = capsys.readouterr()

    assert (0, "") == (code, said.err)
    assert "vehicle.toml: nothing wrong in the file itself" in said.out


def test_the_old_state_is_taken_up(config: Config, caplog: pytest.LogCaptureFixture) -> None:
    """Radii, baseline and standing alarms are those that were saved; nothing is set aside."""
    caplog.set_level(logging.INFO)
    then, now = old_state(), taken_up(config).snapshot()

    assert [f"{config.state.file}: taken up what was learned before"] == caplog.messages
    assert ["bus.dbc", "state.json", "vehicle.toml"] == sorted(
        p.name for p in config.can.dbc.parent.iterdir()
    )
    np.testing.assert_allclose(now["estimator"]["mean_m"], then["estimator"]["mean_m"], rtol=1e-12)
    baseline, before = (one["monitor"]["sets"]["baseline"] for one in (now, then))
    mean = baseline["reference"]["mean"]
    assert before["reference"]["mean"] == mean[:AGE] + mean[AGE + 1 :]
    assert 0.03 == mean[AGE], "not learned by the earlier version: as before the first drive"
    assert (True, before["learned_s"]) == (baseline["ready"], baseline["learned_s"])
    assert [("deflation", "rl"), ("radius_deviation", "rl")] == sorted(
        (alarm["kind"], alarm["wheel"]) for alarm in now["monitor"]["alarms"]
    )


def test_what_was_taken_up_is_saved_and_taken_up_again(
    config: Config, caplog: pytest.LogCaptureFixture
) -> None:
    """The first save by this version loses none of it."""
    first = taken_up(config).snapshot()
    StateKeeper(config, LOG).save(0.0, first)
    second = taken_up(config).snapshot()

    assert [] == [record.message for record in caplog.records if record.levelno > logging.INFO]
    assert first["monitor"] == second["monitor"]
