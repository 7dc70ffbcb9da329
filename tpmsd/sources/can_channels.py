"""Which bus of a log with several is the car's.

In: frames, the identifiers that the configured signals need, the configured channel. Out: the channel to
take, and a note where that is not what was configured. Two buses may share identifiers: their frames in turn
would be two senders of one message.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from itertools import islice

from tpmsd.sources.can_frame import CanFrame
from tpmsd.sources.signal_plan import EXTENDED

LOOK_AT_FRAMES = 50_000
"""About half a minute of a busy bus; each bus of a car has its say by then."""
_NUMBER = re.compile(r"\D*(\d+)\Z")


@dataclass(frozen=True, slots=True)
class Channel:
    """What to take of a log."""

    name: str | None
    """Channel as the log calls it; None: all."""
    note: str = ""
    """What the user should know; empty if all is as configured."""


def bus_numbers(names: Iterable[str], main: str | None, buses: Iterable[str]) -> dict[str, int]:
    """Channel of a log -> number of the bus: 0 for `main` (and for all that no further bus claims).

    `names`: the log's channels; `buses`: configured channels of the further buses, in order.
    """
    numbers = dict.fromkeys(names, 0)
    for number, configured in enumerate(buses, 1):
        for name in numbers:
            same = name == configured or (name.isdecimal() and _number(name) == _number(configured))
            if same and name != main:
                numbers[name] = number
    return numbers


def choose_channel(frames: Iterable[CanFrame], needed: Collection[int], configured: str) -> Channel:
    """The channel to take; all, where no two channels carry needed identifiers.

    `needed`: keys as `compile_plans` has them. Logs of other tools call channels by number alone, which is
    compared with the configured name's.
    """
    found: Counter[str] = Counter()
    for frame in islice(frames, LOOK_AT_FRAMES):
        key = frame.arbitration_id | (EXTENDED if frame.is_extended else 0)
        if key in needed and not (frame.is_error or frame.is_remote):
            found[frame.channel] += 1
    if len(found) < 2:
        return Channel(None)
    same = [name for name in sorted(found) if name == configured] or [
        name for name in sorted(found) if name.isdecimal() and _number(name) == _number(configured)
    ]
    if same:
        return Channel(same[0])
    name = found.most_common(1)[0][0]
    return Channel(
        name,
        f"{' and '.join(sorted(found))} all carry identifiers that are needed, and none is the configured "
        f"{configured}; {name} is taken",
    )


def _number(name: str) -> int | None:
    match = _NUMBER.match(name)
    return None if match is None else int(match[1])
