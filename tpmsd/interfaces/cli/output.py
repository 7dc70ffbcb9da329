"""Output of commands: JSON to a file or standard output, and a progress bar.

In: plain objects, records and numpy values; how much is done. Out: text. Numbers that JSON does not have
(NaN, infinities) become null. The bar is drawn on a terminal only, so that logs and pipes stay clean.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
import time
from collections.abc import Callable
from typing import IO, TYPE_CHECKING, Any

from tpmsd.foundation.plain import plain
from tpmsd.interfaces.cli.output_files import Outputs

if TYPE_CHECKING:
    from tpmsd.interfaces.cli.parser import Parser

    # Generic for type checkers alone; every command's `add_parser(subparsers: Subparsers)` takes it.
    Subparsers = argparse._SubParsersAction[Parser]
else:
    Subparsers = argparse._SubParsersAction

_BAR_WIDTH = 28
_REDRAW_S = 0.1


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """Add the option `--json FILE` to a command."""
    parser.add_argument(
        "--json", metavar="FILE", help="write the report as JSON to FILE ('-' is standard output)"
    )


def dumps(obj: Any, indent: int | None = 2) -> str:
    """Return `obj` as JSON text."""
    return json.dumps(plain(obj), indent=indent, allow_nan=False, ensure_ascii=False)


def json_text(obj: Any) -> str:
    """Return `obj` as a JSON document that ends with a line end."""
    return dumps(obj) + "\n"


def write_json(obj: Any, target: str) -> None:
    """Write `obj` as JSON to the file `target`, or to standard output where it is '-'.

    Raises `OutputError` with one line where the file cannot be written.
    """
    Outputs(("--json", target)).write({"--json": lambda: json_text(obj)})


class Progress:
    """A progress bar over `total_s` seconds of drive, on a terminal only.

    With `rate=False` the total is a share of some work and no time of a drive: the bar alone is drawn.
    `update(done_s)` may be called as often as one likes: it redraws ten times a second at most.
    """

    def __init__(
        self,
        total_s: float,
        label: str,
        stream: IO[str] | None = None,
        clock: Callable[[], float] = time.monotonic,
        *,
        rate: bool = True,
    ) -> None:
        self._rate = rate
        self._total_s = total_s
        self._label = label
        self._stream = stream if stream is not None else sys.stderr
        self._clock = clock
        self._start = clock()
        self._drawn_at = -math.inf
        self._width = 0
        self._shown = bool(getattr(self._stream, "isatty", lambda: False)())

    def update(self, done_s: float) -> None:
        """Show that `done_s` of the total are done."""
        if not self._shown:
            return
        now = self._clock()
        if now - self._drawn_at < _REDRAW_S:
            return
        self._drawn_at = now
        self._overwrite_line(self.text(done_s, now - self._start))

    def text(self, done_s: float, elapsed_s: float) -> str:
        """Return the line for `done_s` of drive after `elapsed_s` of work."""
        known = math.isfinite(self._total_s) and self._total_s > 0 and math.isfinite(done_s)
        share = min(max(done_s / self._total_s, 0.0), 1.0) if known else 0.0
        filled = round(share * _BAR_WIDTH)
        bar = "#" * filled + "." * (_BAR_WIDTH - filled)
        speed = ""
        if self._rate and elapsed_s > 0.5 and known and done_s > 0:
            left_s = elapsed_s * (1.0 / share - 1.0)
            speed = (
                f"  {done_s / elapsed_s:.2g}x"
                if done_s < 10.0 * elapsed_s
                else f"  {done_s / elapsed_s:.0f}x"
            )
            speed += f" real time, {int(left_s) // 60}:{int(left_s) % 60:02d} left"
        return f"{self._label} [{bar}] {share:4.0%}{speed}"

    def close(self) -> None:
        """Remove the bar, so that the next line starts in column one."""
        if self._shown and self._width:
            self._overwrite_line("")
        self._shown = False

    def _overwrite_line(self, line: str) -> None:
        # A line that the terminal breaks in two cannot be drawn over.
        line = line[: shutil.get_terminal_size().columns - 1]
        try:
            self._stream.write("\r" + line.ljust(self._width) + ("\r" if not line else ""))
            self._stream.flush()
        except (OSError, ValueError):
            self._shown = False  # a terminal that went away must not end the work
        self._width = len(line)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
