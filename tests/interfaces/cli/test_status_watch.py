"""The screen of `tpmsd status --watch`: trends in closed form, rates, keys, and a terminal left as it was."""

from __future__ import annotations

import math
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections import deque
from pathlib import Path
from typing import Any

import pytest

from tpmsd.interfaces.cli.status_watch import RANGES_S, View, binned, sparkline


def document(second: int, change_mm: float | None = 0.0) -> dict[str, Any]:
    wheel = {"state": "monitoring", "change_mm": change_mm, "change_std_mm": 0.1}
    return {
        "tpmsd": "1",
        "time": 1000.0 + second,
        "uptime_s": 50.0 + second,
        "ticks": 10 * second,
        "missed_deadlines": 0,
        "wheels": {"rl": dict(wheel), "rr": dict(wheel, change_mm=None)},
        "can": {"state": "ok", "channel": "can0", "frames": 1000 * second},
        "gnss": {"state": "ok", "device": "/dev/gnss", "fixes": 5 * second},
    }


def test_a_trend_is_the_mean_of_each_part() -> None:
    """Six seconds in three parts; what is not known leaves a blank, a ramp rises through all blocks."""
    kept = deque([(0.5, 1.0), (1.5, 3.0), (2.5, math.nan), (4.5, 2.0), (6.0, 4.0)])
    assert [2.0, 3.0] == pytest.approx([binned(kept, 6.0, 3)[0], binned(kept, 6.0, 3)[2]])
    assert math.isnan(binned(kept, 6.0, 3)[1])
    assert "▁▂▃▄▅▆▇█" == sparkline([k / 7.0 for k in range(8)])
    assert "_ #" == sparkline([0.0, math.nan, 1.0], "_.-=+*%#")


def test_noise_does_not_fill_a_trend() -> None:
    """A hundredth of a millimetre stays at the bottom."""
    assert {"▁"} == set(sparkline([0.0, 0.01, 0.005]))


@pytest.mark.parametrize("width", [40, 60, 80, 132])
def test_the_screen_keeps_within_the_terminal(width: int) -> None:
    """No line is wider, no more lines than there are; trend, rates and keys are there."""
    view = View()
    for second in range(90):
        view.update(document(second, 0.01 * second))
    text = view.text(colour=False, width=width, height=24)

    assert width >= max(map(len, text.split("\n")))
    assert 24 >= len(text.split("\n"))
    assert "bus 1000 frames/s, receiver 5 fixes/s" in text
    assert "rear left    " in text.split("change in mm over 2 min")[1]
    assert "q ends" in text
    if width >= 60:
        ends = next(word for word in text.split() if ".." in word).split("..")
        assert [0.0, 0.89] == pytest.approx([float(one) for one in ends], abs=0.03)


def test_keys_change_range_and_pause() -> None:
    """`r` goes round the ranges; a blank pauses and goes on."""
    view = View()
    seen = []
    for _ in RANGES_S:
        seen.append(view.range_s)
        view.key("r")
    assert (list(RANGES_S), RANGES_S[0]) == (seen, view.range_s)
    view.key(" ")
    assert view.paused
    view.update(document(1))
    assert "goes on (paused)" in view.text(colour=False, width=80, height=24)


@pytest.mark.parametrize("odd", [{}, {"wheels": 3}, {"time": "x", "wheels": {"rl": 1}, "can": []}])
def test_odd_documents_are_shown(odd: dict[str, Any]) -> None:
    """What comes from another process is not taken for granted."""
    view = View()
    view.update(document(1))
    view.update(odd)
    assert "q ends" in view.text(colour=True, width=40, height=24)


@pytest.mark.parametrize("interrupts", [signal.SIG_DFL, signal.SIG_IGN])
def test_q_ends_and_leaves_the_terminal_as_it_was(tmp_path: Path, interrupts: signal.Handlers) -> None:
    """In a terminal of its own: the view is drawn, `q` ends it with code 0, echo and screen are back; also
    where interrupts are ignored, as by what a shell began in the background."""
    program = tmp_path / "watch.py"
    program.write_text(
        "import contextlib, itertools, sys, time\n"
        "from tests.interfaces.cli.test_status_watch import document\n"
        "from tpmsd.interfaces.cli.status import watch\n"
        "def documents():\n"
        "    for second in itertools.count():\n"
        "        yield document(second)\n"
        "        time.sleep(0.1)\n"
        "with contextlib.suppress(KeyboardInterrupt):\n"
        "    watch(documents(), sys.stdout)\n"
    )
    ours, theirs = pty.openpty()
    before = termios.tcgetattr(theirs)
    environment = {**os.environ, "TERM": "xterm", "PYTHONPATH": str(Path.cwd())}
    process = subprocess.Popen(
        [sys.executable, str(program)],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env=environment,
        preexec_fn=lambda: signal.signal(signal.SIGINT, interrupts),
    )
    shown = b""
    deadline = time.monotonic() + 30.0
    sent = False
    while process.poll() is None and time.monotonic() < deadline:
        if select.select([ours], [], [], 0.2)[0]:
            shown += os.read(ours, 65536)
        if not sent and b"rear left" in shown:
            os.write(ours, b"q")
            sent = True
    process.kill()
    assert 0 == process.wait(10.0)
    while select.select([ours], [], [], 0.2)[0]:
        shown += os.read(ours, 65536)
    assert shown.startswith(b"\x1b[?1049h")
    assert b"\x1b[?1049l" in shown
    assert before == termios.tcgetattr(theirs)
    os.close(ours)
    os.close(theirs)
