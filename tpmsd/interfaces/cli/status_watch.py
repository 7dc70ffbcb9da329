"""`tpmsd status --watch` on a terminal: the table, trends of the wheels, rates of the sources, keys.

In: status documents as they come; keys from the terminal. Out: a screen that is drawn again in place. The
terminal is left as it was, whatever ends the view.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import shutil
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import IO, Any

from tpmsd.foundation.plain import number
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.status_table import NARROWEST, render_status
from tpmsd.offline.report.wording import wheel_name

RANGES_S = (120.0, 600.0, 3600.0)
"""Length of the trends; a key goes to the next."""
MAX_KEPT = 7200
"""Documents whose numbers are kept: two hours of one each second."""
_BLOCKS, _ASCII = "▁▂▃▄▅▆▇█", "_.-=+*%#"
_ENTER, _LEAVE = "\x1b[?1049h\x1b[?25l", "\x1b[?25h\x1b[?1049l"
_HOME, _CLEAR_LINE, _CLEAR_BELOW = "\x1b[H", "\x1b[K", "\x1b[J"
_COUNTS = (("can", "frames", "bus", "frames/s"), ("gnss", "fixes", "receiver", "fixes/s"))
_MIN_SPAN_MM = 0.2
"""Height of a trend at least, so that a tenth of a millimetre of noise does not fill it."""


@dataclass
class View:
    """State from document to document, and what the keys have set."""

    range_s: float = RANGES_S[0]
    paused: bool = False
    _changes: dict[str, deque[tuple[float, float]]] = field(default_factory=dict)
    _before: Mapping[str, Any] = field(default_factory=dict)
    _now: Mapping[str, Any] = field(default_factory=dict)

    def update(self, document: Mapping[str, Any]) -> None:
        """Keep a document and the radius changes in it."""
        self._before, self._now = self._now, document
        time_s = number(document.get("time"))
        wheels = document.get("wheels")
        if time_s is None or not isinstance(wheels, dict):
            return
        for wheel in WHEELS:
            one = wheels.get(wheel)
            change = number(one.get("change_mm")) if isinstance(one, dict) else None
            kept = self._changes.setdefault(wheel, deque(maxlen=MAX_KEPT))
            if kept and time_s < kept[-1][0]:
                kept.clear()  # the daemon began again
            kept.append((time_s, math.nan if change is None else change))

    def key(self, letter: str) -> None:
        """Act on a key: `r` selects the next range, blank pauses."""
        if letter == "r":
            self.range_s = RANGES_S[(RANGES_S.index(self.range_s) + 1) % len(RANGES_S)]
        elif letter == " ":
            self.paused = not self.paused

    def text(self, *, colour: bool, width: int, height: int, blocks: str = _BLOCKS) -> str:
        """Return the screen: at most `height` lines of at most `width` characters (40 at least)."""
        width = max(width, NARROWEST)
        table = render_status(self._now, colour=colour, width=width).rstrip("\n").split("\n")
        below = ["", *self._trend_lines(width, blocks), *self._rate_line(width), self._key_help()[:width]]
        room = max(height - len(below), 1)
        return "\n".join((table[:room] + below)[:height])

    def _trend_lines(self, width: int, blocks: str) -> list[str]:
        """Return a line per wheel whose change is known: its trend, the least and the greatest value."""
        lines = []
        columns = width - 28 if width >= 60 else width - 14
        for wheel, kept in self._changes.items():
            bins = binned(kept, self.range_s, columns)
            known = [value for value in bins if math.isfinite(value)]
            if known:
                low, high = min(known), max(known)
                ends = f" {low:+.2f}..{high:+.2f}" if width >= 60 else ""
                lines.append(f"{wheel_name(wheel):<12} {sparkline(bins, blocks)}{ends}"[:width])
        head = f"change in mm over {self.range_s / 60.0:.0f} min"
        return [head, *lines, ""] if lines else []

    def _rate_line(self, width: int) -> list[str]:
        """Return the line of frames, fixes and ticks per second between two documents; empty before the
        second."""
        uptimes = [number(one.get("uptime_s")) for one in (self._before, self._now)]
        if uptimes[0] is None or uptimes[1] is None or uptimes[1] <= uptimes[0]:
            return []
        span_s = uptimes[1] - uptimes[0]
        parts = []
        for table, key, name, unit in _COUNTS:
            counts = [number(_table_or_empty(one, table).get(key)) for one in (self._before, self._now)]
            if counts[0] is not None and counts[1] is not None and counts[1] >= counts[0]:
                parts.append(f"{name} {(counts[1] - counts[0]) / span_s:.0f} {unit}")
        return [", ".join(parts)[:width]] if parts else []

    def _key_help(self) -> str:
        return f"q ends  r range  blank {'goes on (paused)' if self.paused else 'pauses'}"


def binned(kept: deque[tuple[float, float]], range_s: float, columns: int) -> list[float]:
    """Return the means of the last `range_s` seconds in `columns` equal parts; NaN for a part without a
    value."""
    sums, counts = [0.0] * columns, [0] * columns
    if not kept:
        return [math.nan] * columns
    end_s = kept[-1][0]
    for time_s, value in reversed(kept):
        at = columns - 1 - int((end_s - time_s) / range_s * columns)
        if at < 0:
            break
        if math.isfinite(value):
            sums[at] += value
            counts[at] += 1
    return [total / count if count else math.nan for total, count in zip(sums, counts, strict=True)]


def sparkline(values: list[float], blocks: str = _BLOCKS) -> str:
    """Return a character per value between the least and the greatest; a blank for NaN."""
    known = [value for value in values if math.isfinite(value)]
    if not known:
        return " " * len(values)
    low = min(known)
    span = max(max(known) - low, _MIN_SPAN_MM)
    top = len(blocks) - 1
    return "".join(
        blocks[round((value - low) / span * top)] if math.isfinite(value) else " " for value in values
    )


def watch_screen(documents: Iterable[Mapping[str, Any]], out: IO[str], colour: bool) -> None:
    """Draw each document until the daemon's end; KeyboardInterrupt where `q` or Ctrl-C ends it before."""
    view, lock = View(), threading.Lock()
    blocks = _BLOCKS if _can_encode(out, _BLOCKS) else _ASCII

    def draw() -> None:
        size = shutil.get_terminal_size()
        text = view.text(colour=colour, width=size.columns, height=size.lines, blocks=blocks)
        out.write(_HOME + text.replace("\n", f"{_CLEAR_LINE}\r\n") + _CLEAR_LINE + _CLEAR_BELOW)
        out.flush()

    def press(letter: str) -> None:
        if letter == "q":
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
            return
        with lock:
            view.key(letter)
            draw()

    out.write(_ENTER)
    try:
        with keys(press):
            for document in documents:
                with lock:
                    if not view.paused:
                        view.update(document)
                    draw()
    finally:
        out.write(_LEAVE)
        out.flush()


@contextlib.contextmanager
def keys(press: Callable[[str], None]) -> Iterator[None]:
    """Call `press` with each key while the block runs; never where standard input is no terminal."""
    import termios
    import tty

    if not sys.stdin.isatty():
        yield
        return
    source = sys.stdin.fileno()
    before = termios.tcgetattr(source)
    ended = threading.Event()

    def listen() -> None:
        while not ended.is_set():
            if select.select([source], [], [], 0.2)[0]:
                for letter in os.read(source, 64).decode("utf-8", "ignore"):
                    press(letter)

    # a shell lets what it begins in the background ignore interrupts, and `q` is one
    interrupted = signal.signal(signal.SIGINT, signal.default_int_handler)
    tty.setcbreak(source)
    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    try:
        yield
    finally:
        ended.set()
        listener.join(1.0)
        termios.tcsetattr(source, termios.TCSADRAIN, before)
        signal.signal(signal.SIGINT, interrupted)


def _can_encode(out: IO[str], text: str) -> bool:
    try:
        text.encode(getattr(out, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        return False
    return True


def _table_or_empty(document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    one = document.get(name)
    return one if isinstance(one, dict) else {}
