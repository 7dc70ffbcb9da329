"""Lines of text logs, as python-can's readers need them.

In: the path of an ASC or TRC file. Out: an iterator of its lines that knows their numbers; for ASC files also
the start that the times count from, which python-can's reader understands in one language only.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from tpmsd.foundation.text_file import open_log

MAX_LINE_CHARS = 4096


class LogLines:
    """A text file, as far as python-can's readers need one, that knows the number of the line read last."""

    def __init__(self, path: Path) -> None:
        self._file = open_log(path)
        self.number = 0
        self.current = ""
        self.start_s = 0.0
        """Origin of the reader's time stamps."""

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        self.current = self._file.readline(MAX_LINE_CHARS)
        if not self.current:
            raise StopIteration
        self.number += 1
        rest = self.current
        while len(rest) == MAX_LINE_CHARS and rest[-1] != "\n":
            rest = self._file.readline(MAX_LINE_CHARS)  # of what is no text: not to fill the memory
        return self.current

    def close(self) -> None:
        """Close the file, as readers do at its end."""
        self._file.close()

    @property
    def closed(self) -> bool:
        """True if the end was reached."""
        return self._file.closed

    def resume(self) -> None:
        """Prepare the file for a reader that continues behind a bad line."""


class AscLines(LogLines):
    """Lines of an ASC file as python-can's reader takes them all, and takes them right.

    Two things in the header it gets wrong. 'timestamps relative' means since the line before; it takes them
    as since the start, so they are summed up here. And a date in another language or form ends the header
    for it, number base and all; so dates become comments here, and `start_s` keeps what they say.
    """

    _DATE = re.compile(r"\s*(?:date|begin\s+triggerblock)\s+(.*)", re.IGNORECASE)
    _RELATIVE = re.compile(r"\s*base\s+\w+\s+timestamps\s+relative", re.IGNORECASE)
    _HEADER_END = re.compile(r"\s*(no\s+)?internal\s+events\s+logged", re.IGNORECASE)
    _TIME = re.compile(r"\s*(\d+\.\d+)(\s.*)", re.DOTALL)

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._relative = False
        self._in_header = True
        self._now_s = 0.0
        self._pushed: list[str] = []

    def __next__(self) -> str:
        if self._pushed:
            return self._pushed.pop()
        line = super().__next__()
        date = self._DATE.match(line)
        if date is not None:
            start_s = asc_date_s(_decode_utf8(date[1]))
            if start_s is not None:
                self.start_s = start_s
            return "// date\n"
        match = self._TIME.match(line)
        if self._in_header:
            self._relative |= self._RELATIVE.match(line) is not None
            self._in_header = match is None and self._HEADER_END.match(line) is None
        if match is None or not self._relative:
            return line
        self._now_s += float(match[1])
        return f"{self._now_s:.9f}{match[2]}"

    def resume(self) -> None:
        """Put a header in front of the remaining lines: a new reader looks for one, and would take the next
        frame for its end."""
        if not self._in_header:
            self._pushed.append("internal events logged\n")


_MONTHS = {
    name: month
    for month, names in enumerate(
        (
            *("jan", "feb fev fév", "mar mär mrz", "apr avr", "may mai", "jun juin"),
            *("jul juil", "aug aou aoû", "sep", "oct okt", "nov", "dec dez déc"),
        ),
        start=1,
    )
    for name in names.split()
}
_CLOCK = re.compile(r"(\d{1,2}):(\d\d):(\d\d)(?:\.(\d{1,9}))?(?:\s*([ap])\.?m)?", re.IGNORECASE)


def _decode_utf8(text: str) -> str:
    """Return text that was decoded as Latin-1 decoded as UTF-8 instead; unchanged if it is not UTF-8."""
    try:
        return text.encode("latin-1").decode("utf-8")
    except UnicodeDecodeError:
        return text


def asc_date_s(text: str) -> float | None:
    """Return the epoch seconds of a date as ASC headers have it, in this machine's time zone; None if it is
    none.

    'Mon Jul 1 10:00:00.123 2024', 'Mon Jul 1 03:00:00.123 pm 2024', and the same in German or French. A
    fraction of less than three digits is python-can's, which writes milliseconds without leading zeros.
    """
    clock = _CLOCK.search(text)
    if clock is None:
        return None
    words = re.findall(r"[^\W\d_]+|\d+", text[: clock.start()] + " " + text[clock.end() :])
    months = [
        _MONTHS[key] for word in words for key in (word[:4].lower(), word[:3].lower()) if key in _MONTHS
    ]
    years = [int(word) for word in words if word.isdigit() and len(word) == 4]
    days = [int(word) for word in words if word.isdigit() and len(word) <= 2]
    if not (months and years and days):
        return None
    hour = int(clock[1])
    if clock[5] is not None:
        hour = hour % 12 + (12 if clock[5].lower() == "p" else 0)
    fraction = clock[4] or "0"
    fraction_s = int(fraction) / (1000 if len(fraction) < 3 else 10 ** len(fraction))
    try:
        # The month is the last match: 'Mar' is also how Tuesday begins in French.
        start = datetime(years[0], months[-1], days[0], hour, int(clock[2]), int(clock[3]))
        return start.timestamp() + fraction_s
    except (ValueError, OverflowError, OSError):
        return None
