"""A reader that crashes, hangs, eats memory or fails ends its child, and the parent says one line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tpmsd.foundation import child_reader
from tpmsd.foundation.child_reader import ChildReader, ChildReadError, Send, limit

MAX_S = 1


def crash(path: Path, requests: Iterator[str], send: Send) -> None:
    send(b"first")
    next(requests)  # what was sent is flushed
    os.kill(os.getpid(), signal.SIGSEGV)


def hang(path: Path, requests: Iterator[str], send: Send) -> None:
    child_reader.CPU_S = MAX_S
    limit(path)
    while True:
        pass


def eat(path: Path, requests: Iterator[str], send: Send) -> None:
    limit(path)
    send(bytes(child_reader.MEMORY_BYTES + (1 << 20)))


def fail(path: Path, requests: Iterator[str], send: Send) -> None:
    print("no message")
    raise KeyError("group")


def echo(path: Path, requests: Iterator[str], send: Send) -> None:
    for request in requests:
        send(request.encode() * 100_000)


@pytest.mark.parametrize(
    ("worker", "reason"),
    [
        ("crash", "its reader was ended by SIGSEGV"),
        ("hang", "takes more time than a file of its size may"),
        ("eat", "MemoryError"),
        ("fail", r"KeyError \('group'\)"),
    ],
)
def test_what_a_reader_does_to_itself_is_one_line(worker: str, reason: str, tmp_path: Path) -> None:
    """Signals, limits and errors of a child are an ChildReadError with the reason."""
    path = tmp_path / "file"
    path.write_bytes(b"x")
    with ChildReader(f"{__name__}:{worker}", path) as child:
        child.ask("go on")
        if worker == "crash":
            assert b"first" == child.receive()
        with pytest.raises(ChildReadError, match=reason):
            child.receive()


def test_requests_are_answered_in_turn(tmp_path: Path) -> None:
    """Each request has its answer, of any length; a child that is left ends."""
    (tmp_path / "file").write_bytes(b"x")
    with ChildReader(f"{__name__}:echo", tmp_path / "file") as child:
        for text in ("a", "bc"):
            child.ask(text)
            assert text.encode() * 100_000 == child.receive()
        number = child._child.pid
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


def test_no_native_reader_of_mf4_runs_in_the_command(tmp_path: Path) -> None:
    """Frames of an MF4 log arrive though the command's own process never imports asammdf."""
    pytest.importorskip("asammdf")
    code = f"""
import sys
from pathlib import Path
from tpmsd.foundation.startup import leave_out_mf4
leave_out_mf4()
from tpmsd.onboard.sources.can.log import read_can_log
print(len(list(read_can_log(Path({str(tmp_path / "can.mf4")!r})))), "asammdf" in sys.modules)
"""
    import can

    with can.Logger(tmp_path / "can.mf4") as writer:
        writer(can.Message(timestamp=1.0, arbitration_id=5, data=b"ab"))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "1 False" == done.stdout.strip(), done.stderr
