"""Logs as `candump -L` writes them, also compressed with gzip.

In: the path of a `.log` or `.log.gz`. Out: blocks of frames; each line that is none is reported to `note` and
skipped. Own parser, because python-can's stops at the first damaged line and takes forty times as long.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

from tpmsd.foundation.text_file import open_log
from tpmsd.onboard.sources.can.block import FrameBlock, block_of
from tpmsd.onboard.sources.can.candump_line import parse_candump_line
from tpmsd.onboard.sources.can.candump_text import parse_lines
from tpmsd.onboard.sources.can.frame import CanFrame

MAX_LINE_CHARS = 4096
CHUNK_CHARS = 1 << 20
"""Text that is read at once: some twenty thousand lines, whose arrays stay in a processor's cache."""
LINES_PER_BLOCK = 4096
"""Frames of a block where lines are read one by one."""

Note = Callable[[int, str], None]


def read_candump(path: Path, note: Note) -> Iterator[FrameBlock]:
    """Yield frames of the file. A compressed file that is cut short or damaged ends there, which is noted."""

    def bad(number: int, line: str) -> None:
        note(number, _reason(line))

    number, rest = 0, ""
    with open_log(path) as file:
        while True:
            try:
                text = file.read(CHUNK_CHARS)
            except (OSError, EOFError, zlib.error):
                break  # read again line by line: what stands before the damage is to be had
            if not text and not rest:
                return
            text = rest + text if text else rest + "\n"
            end = text.rfind("\n") + 1
            whole, rest = text[:end], text[end:]
            if _has_long_line(whole) or len(rest) >= MAX_LINE_CHARS:
                break
            if not whole:
                continue
            block = parse_lines(whole, number + 1, bad)
            number += whole.count("\n")
            if len(block):
                yield block
    yield from _read_lines(path, number, note)


def _has_long_line(text: str) -> bool:
    """Return whether any line is as long as the limit, which no line of a log reaches."""
    at = 0
    while at + MAX_LINE_CHARS <= len(text):
        end = text.rfind("\n", at, at + MAX_LINE_CHARS)
        if end < 0:
            return True
        at = end + 1
    return False


def _read_lines(path: Path, skipped: int, note: Note) -> Iterator[FrameBlock]:
    """Yield the frames behind the first `skipped` lines, one by one: of files that are damaged, or no
    text."""
    number = 0
    frames: list[CanFrame] = []
    with open_log(path) as file:
        try:
            while line := file.readline(MAX_LINE_CHARS):
                number += 1
                if number <= skipped:
                    continue
                frame = parse_candump_line(line, number)
                if frame is not None:
                    frames.append(frame)
                    if len(frames) == LINES_PER_BLOCK:
                        yield block_of(frames)
                        frames.clear()
                elif line.strip():
                    note(number, _reason(line))
                    # A binary file may have no line end for as long as it goes: it must not fill the memory.
                    while len(line) == MAX_LINE_CHARS and line[-1] != "\n":
                        line = file.readline(MAX_LINE_CHARS)
        except EOFError:
            note(number + 1, "the compressed file is cut short")
        except (OSError, zlib.error) as error:
            note(number + 1, f"the file cannot be read on: {error}")
    if frames:
        yield block_of(frames)


def _reason(line: str) -> str:
    """Return why a line is rejected, for a message: its text, shortened."""
    text = line.strip()
    text = text if len(text) <= 60 else text[:57] + "..."
    return f"not a candump line: {text!r}"
