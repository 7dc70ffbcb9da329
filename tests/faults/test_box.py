"""The box fails under the daemon: a full, read-only or slow disk, and no descriptors left."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.faults.brown_out import brown_out, problems
from tests.faults.test_process import until
from tests.onboard.daemon.fakes import car
from tests.onboard.daemon.test_run_command import PATIENCE_S, daemon, ended, wait_for
from tpmsd.onboard.sinks.state_file import load_state
from tpmsd.onboard.sinks.status_client import StatusError, read_status

SAVED = "interval_s = 1.0\n"
FAST = ("--speed-up", "5")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own, of 256 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)], capture_output=True, text=True
    )
    if mounted.returncode != 0:
        pytest.skip(f"no right to mount a file system: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def more_ticks(path: Path, count: int) -> None:
    """Wait until the daemon has made so many more."""
    before = read_status(path)["ticks"]
    until(path, f"{count} more ticks", lambda document: document["ticks"] >= before + count)


def exists_at_last(path: Path) -> bool:
    """Whether the file comes within the tests' patience."""
    end_s = time.monotonic() + PATIENCE_S
    while not path.exists() and time.monotonic() < end_s:
        time.sleep(0.02)
    return path.exists()


def test_a_full_disk_costs_the_state_alone(tmp_path: Path, small_disk: Path) -> None:
    """On a full disk (ENOSPC) saving fails with one line, after a start too; with room it works again."""
    config, _ = car(tmp_path / "car", SAVED)
    state, ballast = small_disk / "state.json", small_disk / "ballast"
    options = ("--config", tmp_path / "car", "--state", state, *FAST)

    def fill() -> None:
        with ballast.open("ab", buffering=0) as filler, pytest.raises(OSError, match="No space"):
            while True:
                filler.write(b"x" * 1024)

    with daemon(*options) as process:
        wait_for("ticks", config.status.socket)
        assert exists_at_last(state)
        fill()
        more_ticks(config.status.socket, 100)
        stopped, log = ended(process, signal.SIGTERM)
    (small_disk / ".state.json.lock").unlink()
    fill()
    with daemon(*options) as process:
        wait_for("ticks", config.status.socket)
        more_ticks(config.status.socket, 50)
        ballast.unlink()
        more_ticks(config.status.socket, 50)
        code, second_log = ended(process, signal.SIGTERM)

    assert (0, 0) == (stopped, code)
    assert 1 == log.count("No space left on device; trying again later")
    assert "taken up what was learned before" in second_log
    assert [1, 1] == [second_log.count(text) for text in ("; trying again later", "saved again")]
    assert load_state(state) is not None


def test_a_read_only_disk_costs_the_state_alone(tmp_path: Path, small_disk: Path) -> None:
    """On a read-only disk (EROFS) what it holds is taken up, and saving fails with one line."""
    config, _ = car(tmp_path / "car", SAVED)
    state, seen = small_disk / "state.json", []
    for mode in ("rw", "ro"):
        subprocess.run(["mount", "-o", f"remount,{mode}", str(small_disk)], check=True)
        with daemon("--config", tmp_path / "car", "--state", state, *FAST) as process:
            wait_for("ticks", config.status.socket)
            more_ticks(config.status.socket, 100)
            seen.append(ended(process, signal.SIGTERM))

    assert [0, 0] == [code for code, _ in seen]
    assert "taken up what was learned before" in seen[1][1]
    assert 1 == seen[1][1].count("Read-only file system; trying again later")
    assert load_state(state) is not None


@pytest.mark.skipif(shutil.which("cc") is None, reason="takes a C compiler")
def test_a_disk_that_does_not_answer_holds_up_no_tick(tmp_path: Path) -> None:
    """While an fsync hangs, 30 s of ticks are made; once it returns the state is there."""
    library, held = tmp_path / "held_disk.so", tmp_path / "held"
    source = Path(__file__).with_name("held_disk.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    config, _ = car(tmp_path, SAVED)
    held.touch()
    environment = {"LD_PRELOAD": str(library), "HELD_DISK": str(held)}
    with daemon("--config", tmp_path, "--speed-up", "10", **environment) as process:
        wait_for("ticks", config.status.socket)
        assert exists_at_last(tmp_path / ".state.json.new")
        more_ticks(config.status.socket, 300)
        assert not (tmp_path / "state.json").exists()
        held.unlink()
        assert exists_at_last(tmp_path / "state.json")
        code, log = ended(process, signal.SIGTERM)

    assert 0 == code
    assert load_state(tmp_path / "state.json") is not None
    assert "not saved" not in log


def test_without_descriptors_ticks_go_on(tmp_path: Path) -> None:
    """With none left nobody new is answered and no state saved, ticks go on; with some it all works."""
    config, _ = car(tmp_path, SAVED)
    with daemon("--config", tmp_path, *FAST) as process, ExitStack() as clients:
        wait_for("ticks", config.status.socket)
        watcher = clients.enter_context(socket.socket(socket.AF_UNIX))
        watcher.settimeout(PATIENCE_S)
        watcher.connect(str(config.status.socket))
        watcher.sendall(b"watch\n")
        lines = watcher.makefile("rb")
        lines.readline()
        highest = max(int(entry.name) for entry in Path(f"/proc/{process.pid}/fd").iterdir())
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (highest + 1, 4096))
        free = highest + 1 - len(list(Path(f"/proc/{process.pid}/fd").iterdir()))
        for _ in range(free + 3):
            clients.enter_context(socket.socket(socket.AF_UNIX)).connect(str(config.status.socket))
        began_s, began_cpu_s = time.monotonic(), cpu_s(process.pid)
        for _ in range(4):
            assert lines.readline()
        busy = (cpu_s(process.pid) - began_cpu_s) / (time.monotonic() - began_s)
        with pytest.raises(StatusError):
            read_status(config.status.socket, 2.0)
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (4096, 4096))
        clients.close()
        until(config.status.socket, "an answer", lambda document: document["ticks"] > 0)
        assert exists_at_last(tmp_path / "state.json")
        code, log = ended(process, signal.SIGTERM)

    assert 0 == code
    assert busy < 0.8, "the loop spins"
    assert "Traceback" not in log
    assert load_state(tmp_path / "state.json") is not None


def test_power_that_fails_every_ten_seconds_loses_nothing_learned(tmp_path: Path) -> None:
    """Killed at random ticks, with a clock that begins in 1970 each time: the first tick within two seconds,
    what is learned only grows, no false alarm; once the power stays, a puncture is found."""
    lives = brown_out(340.0, 2, tmp_path)

    assert [] == problems(lives)
    assert len(lives) > 15


def cpu_s(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
