"""Recordings of a CAN bus, frame by frame.

In: the path of a log. Out: an iterator of `CanFrame`; what cannot be read goes to a callback with its line
and skipped. `InputError` only where there is nothing to read at all.

    .log .log.gz           candump -L lines, by our own parser (`log_candump`)
    .asc .blf .trc .mf4    by python-can's readers (`log_others`); .mf4 needs the extra `mf4`

Times are host times in epoch seconds where the format knows them; ASC has local time (taken in this machine's
zone), and TRC 1.0 and some ASC files know only seconds since the start.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from tpmsd.foundation.errors import InputError
from tpmsd.onboard.sources.can.block import FrameBlock, block_of
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.log_candump import read_candump

__all__ = ["SUFFIXES", "BadLine", "CanFrame", "find_can_log", "read_can_blocks", "read_can_log"]

BadLine = Callable[[int, str], None]
"""Called with the line number (0 where the format has no lines) and the reason."""

FRAMES_PER_BLOCK = 4096
"""Frames per block of formats that are read frame by frame."""


def read_by_python_can(suffix: str, path: Path, note: BadLine) -> Iterator[CanFrame]:
    """Read a log with `log_others`, which imports python-can."""
    from tpmsd.onboard.sources.can import log_others

    return log_others.read_by_python_can(suffix, path, note)


Reader = Callable[[Path, BadLine], Iterator[FrameBlock] | Iterator[CanFrame]]
"""Reads the log of a path; the callback gets each line that was skipped. Yields frames, or blocks of them."""

READERS: dict[str, Reader] = {
    ".log": read_candump,
    ".log.gz": read_candump,
    **{suffix: partial(read_by_python_can, suffix) for suffix in (".asc", ".blf", ".trc", ".mf4")},
}
"""Reader by file suffix; another format is one more row."""
SUFFIXES = tuple(READERS)


def find_can_log(drive_folder: str | Path) -> Path:
    """Return the log of a drive folder: its one file `can.*` of a known format."""
    folder = Path(drive_folder)
    allowed = "can" + " can".join(READERS)
    try:
        named = sorted(entry for entry in folder.iterdir() if is_can_log(entry))
    except OSError as error:
        raise InputError(folder, error.strerror or str(error)) from None
    found = [entry for entry in named if entry.is_file()]
    if named and not found:
        raise InputError(named[0], "not a file")
    if not found:
        raise InputError(folder, f"no CAN log; looked for {allowed}")
    if len(found) > 1:
        names = " ".join(entry.name for entry in found)
        raise InputError(folder, f"more than one CAN log ({names}); looked for one of {allowed}")
    return found[0]


def read_can_log(path: str | Path, on_bad_line: BadLine | None = None) -> Iterator[CanFrame]:
    """Return frames in the order of the file, error and remote frames among them; as `read_can_blocks`."""
    blocks = read_can_blocks(path, on_bad_line)
    return (frame for block in blocks for frame in block.frames())


def read_can_blocks(path: str | Path, on_bad_line: BadLine | None = None) -> Iterator[FrameBlock]:
    """Return frames in the order of the file, error and remote frames among them, some thousand at a time.

    `on_bad_line` hears of everything that was skipped; a file cut short is reported with its last line and
    ends there. Raises `InputError` at once if the file cannot be opened or its format is not known, and at
    the end of the iteration if there was not one valid frame.
    """
    path = Path(path)
    suffix = _suffix(path)
    if suffix is None:
        raise InputError(path, f"not a known CAN log format; known are {' '.join(READERS)}")
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except OSError as error:
        raise InputError(path, error.strerror or str(error)) from None
    if empty:
        raise InputError(path, "the file is empty")
    first_bad: list[tuple[int, str]] = []

    def note(line: int, reason: str) -> None:
        if not first_bad:
            first_bad.append((line, reason))
        if on_bad_line is not None:
            on_bad_line(line, reason)

    return _require_frames(path, _in_blocks(READERS[suffix](path, note)), first_bad)


def _in_blocks(read: Iterator[FrameBlock] | Iterator[CanFrame]) -> Iterator[FrameBlock]:
    """Yield frames as blocks: single ones gathered, blocks as they are."""
    frames: list[CanFrame] = []
    for item in read:
        if isinstance(item, FrameBlock):
            yield item
            continue
        frames.append(item)
        if len(frames) == FRAMES_PER_BLOCK:
            yield block_of(frames)
            frames.clear()
    if frames:
        yield block_of(frames)


def _require_frames(
    path: Path, blocks: Iterator[FrameBlock], first_bad: list[tuple[int, str]]
) -> Iterator[FrameBlock]:
    """Yield the blocks; an `InputError` at the end if there were none."""
    empty = True
    for block in blocks:
        empty = False
        yield block
    if empty:
        line, reason = first_bad[0] if first_bad else (0, "")
        raise InputError(path, f"no CAN frame in it{f'; {reason}' if reason else ''}", line or None)


def _suffix(path: Path) -> str | None:
    """Return the suffix of a known log format that the file's name ends with; None if there is none."""
    name = path.name.lower()
    return next((suffix for suffix in sorted(READERS, key=len, reverse=True) if name.endswith(suffix)), None)


def is_can_log(path: Path) -> bool:
    """Return whether this is the name of a drive folder's CAN log."""
    suffix = _suffix(path)
    return suffix is not None and path.name.lower() == f"can{suffix}"
