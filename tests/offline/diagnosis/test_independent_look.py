"""`bench.campaigns.offline.independent_look` on a drive whose physics is known."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.offline.independent_look import look, regress
from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive


def test_it_returns_what_was_put_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Growth with speed, load transfer in bends and a latency come back within four standard deviations."""
    truth = {"growth with v2": 4e-6, "lateral load": 2e-4, "latency": 0.1}
    physics = {
        "centrifugal_growth": {"coefficient": truth["growth with v2"]},
        "load_transfer_lateral": {"coefficient": truth["lateral load"]},
        "gnss_latency": {"latency_s": truth["latency"]},
    }
    write_folder(drive(Spec(duration_s=500.0, physics=physics), 23), tmp_path / "known")
    with np.errstate(divide="ignore", invalid="ignore"):
        look(tmp_path / "known")
    text = capsys.readouterr().out.split("front right over left")[1]

    for name, value in truth.items():
        found = re.search(rf"^    {name} +(\S+) \+- (\S+) ", text, re.MULTILINE)
        assert found is not None, text
        assert abs(float(found[1]) - value) < 4 * float(found[2]) < value


def test_a_bootstrap_over_blocks_knows_errors_that_blocks_share() -> None:
    """With an error common to each block of 30 the standard deviation is that of the blocks."""
    rng = np.random.default_rng(4)
    column = np.repeat(rng.standard_normal(60), 30)
    y = 2.0 * column + np.repeat(rng.standard_normal(60), 30) + 0.01 * rng.standard_normal(1800)
    values, stds, count = regress(y, [column])

    assert 1800 == count
    assert stds[0] == pytest.approx(1 / np.sqrt(60), rel=0.4)
    assert abs(values[0] - 2.0) < 4 * stds[0]
