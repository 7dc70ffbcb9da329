"""Selection of the car's bus in a log with several.

In: frames, the identifiers that the configured signals need, the configured channel. Out: the channel to
take, and a note where that is not what was configured. Two buses may share identifiers: their frames in turn
would be two senders of one message.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from tpmsd.onboard.sources.can.block import ERROR, REMOTE, FrameBlock

LOOK_AT_FRAMES = 50_000
"""Frames that are looked at, about half a minute of a busy bus: each bus of a car has sent by then."""
MAX_KEY = 0xFFFFFFFF
"""Keys beyond it are of further buses."""
_NUMBER = re.compile(r"\D*(\d+)\Z")


@dataclass(frozen=True, slots=True)
class Channel:
    """Channel to take of a log."""

    name: str | None
    """Channel as the log calls it; None: all."""
    note: str = ""
    """Note for the user; empty if all is as configured."""


def bus_numbers(names: Iterable[str], main: str | None, buses: Iterable[str]) -> dict[str, int]:
    """Return a mapping from the log's channels to bus numbers: 0 for `main` (and all channels of no further
    bus).

    `names`: the log's channels; `buses`: configured channels of the further buses, in order.
    """
    numbers = dict.fromkeys(names, 0)
    for number, configured in enumerate(buses, 1):
        for name in numbers:
            same = name == configured or (
                name.isdecimal() and _trailing_number(name) == _trailing_number(configured)
            )
            if same and name != main:
                numbers[name] = number
    return numbers


def channel_names(blocks: Iterable[FrameBlock]) -> list[str]:
    """Return the channels that the first frames of a log name, in order of appearance."""
    return list(dict.fromkeys(name for block in _first_frames(blocks) for name in block.channels))


def choose_channel(blocks: Iterable[FrameBlock], needed: Collection[int], configured: str) -> Channel:
    """Return the channel to take of a log with several; all where no two channels carry needed identifiers.

    `needed`: keys as `compile_plans` has them. Logs of other tools call channels by number alone, which is
    compared with the configured name's.
    """
    found: Counter[str] = Counter()
    keys = np.array([key for key in needed if key <= MAX_KEY], dtype=np.uint32)
    for block in _first_frames(blocks):
        carry = np.isin(block.identifier, keys) & (block.flags & (ERROR | REMOTE) == 0)
        numbers = np.bincount(block.channel[carry], minlength=len(block.channels))
        found.update(
            {name: int(number) for name, number in zip(block.channels, numbers, strict=True) if number}
        )
    if len(found) < 2:
        return Channel(None)
    same = [name for name in sorted(found) if name == configured] or [
        name
        for name in sorted(found)
        if name.isdecimal() and _trailing_number(name) == _trailing_number(configured)
    ]
    if same:
        return Channel(same[0])
    name = found.most_common(1)[0][0]
    return Channel(
        name,
        f"{' and '.join(sorted(found))} all carry identifiers that are needed, and none is the configured "
        f"{configured}; {name} is taken",
    )


def _first_frames(blocks: Iterable[FrameBlock]) -> Iterator[FrameBlock]:
    """Yield the first `LOOK_AT_FRAMES` frames, in blocks."""
    left = LOOK_AT_FRAMES
    for block in blocks:
        yield block.select(slice(left))
        left -= len(block)
        if left <= 0:
            return


def _trailing_number(name: str) -> int | None:
    """Return the number in a channel's name; None if it has none."""
    match = _NUMBER.match(name)
    return None if match is None else int(match[1])
