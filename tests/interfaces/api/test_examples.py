"""The examples of the docs and the docstrings run, and say what they promise."""

from __future__ import annotations

import doctest
import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[3] / "docs" / "examples"
EXPECTED = {
    "from_a_drive_to_an_alarm": ["deflation rl raised", "mm against its baseline"],
    "what_my_simulator_leaves_out": ["mismatch", "gnss_latency 0.2"],
    "a_fleet": ["6 drives worked on: {'done': 6}", "van-1  deflation", "[now] van-1: deflation rear right"],
}


def test_every_example_is_tested() -> None:
    """No example is in the docs' folder that is not run here."""
    assert set(EXPECTED) == {path.stem for path in EXAMPLES.glob("*.py")}


@pytest.mark.parametrize("name", EXPECTED)
def test_an_example_runs(name: str, tmp_path: Path) -> None:
    """Each example ends well and prints what it is about."""
    environment = {**os.environ, "MPLBACKEND": "Agg", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py")],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )

    assert (0, "") == (done.returncode, done.stderr if done.returncode else "")
    assert [] == [text for text in EXPECTED[name] if text not in done.stdout], done.stdout


@pytest.mark.parametrize("module", ["tpmsd.interfaces.api.functions", "tpmsd.offline.drives.drive"])
def test_docstrings_are_true(module: str) -> None:
    """The examples in the docstrings give what they show."""
    result = doctest.testmod(importlib.import_module(module))

    assert result.attempted > 0
    assert 0 == result.failed
