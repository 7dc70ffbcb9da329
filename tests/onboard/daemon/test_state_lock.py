"""One daemon per state file."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tpmsd.onboard.daemon.state_lock import StateInUseError, state_lock

HOLD = (
    "import sys; from pathlib import Path; from tpmsd.onboard.daemon.state_lock import state_lock\n"
    "with state_lock(Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
)


def test_a_second_daemon_is_refused_until_the_first_is_dead(tmp_path: Path) -> None:
    """The line names the process that has the file; however that process ends, the lock goes with it."""
    state = tmp_path / "state.json"
    first = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(state)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert first.stdout is not None
    assert "held\n" == first.stdout.readline()
    with pytest.raises(StateInUseError, match=rf"another tpmsd \(process {first.pid}\) keeps its state"):
        state_lock(state).__enter__()
    first.kill()
    first.communicate()
    with state_lock(state):
        pass


def test_two_files_are_two_locks(tmp_path: Path) -> None:
    """Daemons for two buses run side by side."""
    with state_lock(tmp_path / "a.json"), state_lock(tmp_path / "b.json"), state_lock(None):
        pass


def test_a_pipe_in_the_locks_place_does_not_hang_the_start(tmp_path: Path) -> None:
    """Whatever lies there is not waited for."""
    os.mkfifo(tmp_path / ".state.json.lock")
    with state_lock(tmp_path / "state.json"):
        pass


def test_a_link_in_the_locks_place_is_not_followed(tmp_path: Path) -> None:
    """Nothing is written through it."""
    (tmp_path / "precious").write_text("mine")
    (tmp_path / ".state.json.lock").symlink_to(tmp_path / "precious")
    with state_lock(tmp_path / "state.json"):
        pass
    assert "mine" == (tmp_path / "precious").read_text()


def test_folders_of_the_state_are_made(tmp_path: Path) -> None:
    """The lock holds from the first start on, before there is a state or a folder of its own."""
    state = tmp_path / "a" / "b" / "state.json"
    with state_lock(state), pytest.raises(StateInUseError):
        state_lock(state).__enter__()
