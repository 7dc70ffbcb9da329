"""The bench that times commands: processes that are awaited count, failures are errors."""

from __future__ import annotations

import subprocess
import sys

import pytest

from bench.campaigns.command_times import BARS_S, _run, cpu_s


def test_the_time_of_a_child_is_counted() -> None:
    """A process that computes for 0.2 s takes at least that."""
    busy = "import time\nwhile time.process_time() < 0.2: pass"

    def run() -> None:
        subprocess.run([sys.executable, "-S", "-c", busy], check=True)

    assert cpu_s(run) >= 0.2
    assert {"replay", "discover --dbc", "check", "explain", "web"} == set(BARS_S)


def test_a_command_that_fails_is_no_figure() -> None:
    """Its last words are the error."""
    with pytest.raises(RuntimeError, match="no such drive folder"):
        _run(["replay", "/nowhere"])
