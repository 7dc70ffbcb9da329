"""Reads a log of NMEA sentences.

In: a file with lines as `candump` writes them, `(1719820800.112233) $GNRMC,...*hh`, or plain sentences; `.gz`
as well. Out: (time, sentence, line number). Only a file without any usable line is an error; bad lines are
reported to a callback.

In a plain file the sentences' own UTC is the clock: all lines of an epoch bear its Unix time.
"""

from __future__ import annotations

import gzip
import math
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

from tpmsd.foundation.errors import InputError
from tpmsd.foundation.text_file import open_log
from tpmsd.onboard.sources.gnss.nmea_clock import ReceiverClock
from tpmsd.onboard.sources.gnss.nmea_sentence import NmeaReading, SentenceError, decode_sentence

Entry = tuple[float, bytes, int]
BadLine = Callable[[int, str], None]

MAX_LINE_CHARS = 4096
"""A longer line is no text; it is skipped in pieces, so that a binary file does not fill the memory."""
_LOOK_AHEAD_LINES = 1000
_MAX_HELD = 64
_PREFIXED = re.compile(r"\s*\((\d{1,12}(?:\.\d*)?)\)\s*(.*)", re.ASCII | re.DOTALL)


def read_nmea_log(path: str | Path, on_bad_line: BadLine | None = None) -> Iterator[Entry]:
    """Yield (time_s, sentence, line number) in the order of the file.

    A sentence is handed on as it is, also if it is broken: the assembler counts it. `on_bad_line(line number,
    reason)` hears of every line that cannot be handed on.

    Raises `InputError` (file, reason, first bad line) if the file cannot be read or has no usable line.
    """
    path = Path(path)
    report = _Report(on_bad_line)
    entries = _read_prefixed(path, report) if bears_host_times(path) else _read_plain(path, report)
    empty = True
    for entry in entries:
        empty = False
        yield entry
    if empty:
        raise InputError(path, report.first_reason or "holds no line", report.first_line)


class _Report:
    """Passes bad lines on and remembers the first."""

    def __init__(self, on_bad_line: BadLine | None) -> None:
        self._on_bad_line = on_bad_line
        self.first_line: int | None = None
        self.first_reason = ""

    def __call__(self, number: int, reason: str) -> None:
        if not self.first_reason:
            self.first_line, self.first_reason = number, reason
        if self._on_bad_line is not None:
            self._on_bad_line(number, reason)


def _lines(path: Path, report: Callable[[int, str], None]) -> Iterator[tuple[int, str]]:
    """Yield (line number, text) of every line that is not blank and not too long."""
    number, skipping = 0, False
    try:
        with open_log(path) as file:
            while text := file.readline(MAX_LINE_CHARS):
                cut = not text.endswith("\n") and len(text) == MAX_LINE_CHARS
                if not skipping:
                    number += 1
                    if cut:
                        report(number, f"longer than {MAX_LINE_CHARS} bytes")
                    elif not text.isspace():
                        yield number, text.strip()
                skipping = cut
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        report(number + 1, f"compressed data damaged: {error}")
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from None


def bears_host_times(path: Path) -> bool:
    """Return whether lines bear the host's time, by the first of them, as a log may start in the middle of
    one."""
    lines = _lines(path, lambda *_: None)
    return any(_PREFIXED.match(text) for (_, text), _ in zip(lines, range(_LOOK_AHEAD_LINES), strict=False))


def _sentence_bytes(text: str) -> bytes:
    """Return the bytes from the last `$` on, as `NmeaFramer` has them; without one, all."""
    return text[max(text.rfind("$"), 0) :].strip().encode("latin-1")


def _read_prefixed(path: Path, report: _Report) -> Iterator[Entry]:
    """Yield the sentences of a log whose lines bear the host's time."""
    for number, text in _lines(path, report):
        match = _PREFIXED.match(text)
        if match is None:
            # Its UTC would be another clock than that of its neighbours.
            report(number, "no (time) in front")
        elif not match[2]:
            report(number, "nothing behind the time")
        else:
            yield float(match[1]), _sentence_bytes(match[2]), number


def _read_plain(path: Path, report: _Report) -> Iterator[Entry]:
    """Yield plain sentences stamped with their epoch's UTC.

    A sentence without a time (VTG) belongs to the epoch before it, unless that epoch has one of its type
    already: then it is the first of the next, and is held until that tells its time.
    """
    # GGA tells the time of day alone. The first date in the file tells the day of the sentences before it.
    clock = ReceiverClock()
    dated_s = _first_date(path)
    undated = math.isnan(dated_s)
    if undated:
        dated_s = 43200.0  # noon, so that any time of day is nearest to 1970-01-01
    now_s, time_of_day_s = math.nan, math.nan
    seen: set[str] = set()
    held: list[tuple[bytes, int]] = []
    first_number: int | None = None
    for number, text in _lines(path, report):
        if "$" not in text:
            report(number, "neither a (time) nor a $ sentence")
            continue
        first_number = first_number or number
        line = _sentence_bytes(text)
        reading = _try_decode(line)
        if not math.isnan(reading.time_of_day_s):
            if undated:
                report(number, "no sentence of the file has a date: times count from 1970-01-01")
                undated = False
            if reading.time_of_day_s != time_of_day_s:
                time_of_day_s, seen = reading.time_of_day_s, {_try_decode(early).kind for early, _ in held}
            now_s = clock.resolve(time_of_day_s, reading.unix_day, dated_s)
            yield from _release(held, now_s)
            yield now_s, line, number
        elif held or math.isnan(now_s) or (reading.kind == "VTG" and reading.kind in seen):
            held.append((line, number))
            if len(held) > _MAX_HELD:
                yield from _release(held, now_s)
        else:
            yield now_s, line, number
        seen.add(reading.kind)
    yield from _release(held, now_s)
    if math.isnan(now_s) and first_number is not None:
        report(first_number, "neither a (time) in front of the lines nor a sentence with a time")


def _release(held: list[tuple[bytes, int]], now_s: float) -> Iterator[Entry]:
    """Yield the held sentences stamped with `now_s` and empty the list; none if it is NaN."""
    if not math.isnan(now_s):
        yield from ((now_s, line, number) for line, number in held)
    held.clear()


def _first_date(path: Path) -> float:
    """Return Unix seconds of the first sentence with date and time; NaN if the file has none."""
    for _, text in _lines(path, lambda *_: None):
        reading = _try_decode(_sentence_bytes(text))
        if reading.unix_day is not None and not math.isnan(reading.time_of_day_s):
            return reading.unix_day * 86400.0 + reading.time_of_day_s
    return math.nan


def _try_decode(line: bytes) -> NmeaReading:
    """Return a line's reading; one of the kind 'broken' where it is no sound sentence."""
    try:
        return decode_sentence(line)
    except SentenceError:
        return NmeaReading("broken")
