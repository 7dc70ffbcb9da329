"""Text in lines that fit into the terminal: broken between words, rows hanging below their second column.

In: text and the stream it goes to. Out: text; for a file or a pipe the same as went in.
"""

from __future__ import annotations

import re
import shutil
import textwrap
from typing import IO

_NARROWEST = 40
_FIRST_COLUMN = re.compile(r"\s*\S+(?: \S+)* {2,}")
_LIST_MARKER = re.compile(r"\s*\d+\. ")
_BEFORE_STD, _UNBROKEN_STD = " +- ", "\u00a0+-\u00a0"
_PAINTED = re.compile(r"(\x1b\[[\d;]+m)([^\x1b]*)(\x1b\[0m)")


def fitted_to(out: IO[str], text: str) -> str:
    """Return the text in lines that fit into the terminal `out`; unchanged where `out` is a file or a pipe.

    Later lines of a row stand below its second column, where that leaves half of the width, and those of a
    sentence below its first word. A value and its standard deviation stay on one line.
    """
    if not getattr(out, "isatty", lambda: False)():
        return text
    width = max(shutil.get_terminal_size().columns, _NARROWEST)
    return "\n".join(part for line in text.split("\n") for part in _wrap_line(line, width))


def _wrap_line(line: str, width: int) -> list[str]:
    """Return a line in parts of at most `width` visible characters; the colour of a whole line continues."""
    if painted := _PAINTED.fullmatch(line):
        parts = _wrap_line(painted[2], width)
        return [painted[1] + parts[0], *parts[1:-1], parts[-1] + painted[3]] if parts[1:] else [line]
    if len(line) <= width or "\x1b" in line:
        return [line]
    start = _FIRST_COLUMN.match(line)
    indent = len(line) - len(line.lstrip())
    marker = _LIST_MARKER.match(line)
    column = start.end() if start else marker.end() if marker else indent
    if column > width // 2:  # no room for two columns: their blanks go
        line, column = line[:indent] + re.sub(" {2,}", "  ", line[indent:]), indent + 4
    parts = textwrap.wrap(
        line.replace(_BEFORE_STD, _UNBROKEN_STD),
        width,
        subsequent_indent=" " * column,
        break_on_hyphens=False,
        replace_whitespace=False,
    )
    return [part.replace(_UNBROKEN_STD, _BEFORE_STD) for part in parts]
