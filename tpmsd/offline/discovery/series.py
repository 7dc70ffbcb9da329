"""A field of a message over the drive: as a counter, or as a value.

In: stamps and raw bits. Out: `Series`: counts or value per second over the cells of the reference, with
the modulus of a counter. Nothing is said here of what the field means.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.plain import brief
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.frames import MessageLog
from tpmsd.offline.discovery.reference import bin_means
from tpmsd.offline.discovery.settings import SETTINGS
from tpmsd.offline.rings.counter import Counter
from tpmsd.onboard.sources.can.signal_bits import RawArray
from tpmsd.onboard.sources.can.signal_plan import BitField

Kind = Literal["count", "value"]


@dataclass(frozen=True, slots=True)
class MessageField:
    """Position of a value in a message, and its conversion by a DBC."""

    message: str
    name: str
    key: int
    layout: BitField
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""
    invalid: frozenset[int] = frozenset()
    stated_modulus: int = 0
    """Modulus that the DBC hints at; 0: none."""
    selectors: tuple[tuple[BitField, frozenset[int]], ...] = ()
    """Multiplexers above it, outermost first, and the numbers that select it."""

    @property
    def signal(self) -> str:
        """Name of the signal as 'Message.Signal'."""
        return f"{self.message}.{self.name}"


@brief
@dataclass(frozen=True, slots=True)
class Series:
    """A field read in one way."""

    field: MessageField
    kind: Kind
    rate: FloatArray
    """(n,) over each cell: raw counts per second, or the mean of the raw number. NaN where unknown."""
    modulus: int = 0
    """Number of values of a counter; 0 for values."""
    modulus_seen: bool = False
    """True if roll-overs showed the modulus; else it is the field's width."""
    period_s: float = 0.0
    no_value: frozenset[int] = frozenset()
    """Raw values that mean 'no value', other than those that the DBC names."""
    step_rms: float = 0.0
    """Root mean square of a value's steps from frame to frame, in raw units; 0 for counters."""


def as_value(field: MessageField, log: MessageLog, raw: RawArray, edges: FloatArray) -> Series:
    """Return the field as a number (signed and float as the field says); raw values that mean 'no value'
    are left out."""
    layout = field.layout
    plain = not layout.is_float and not layout.signed and not field.invalid
    no_value = _no_value_number(raw) if plain else frozenset()
    if layout.is_float:
        width = {16: np.float16, 32: np.float32, 64: np.float64}[layout.length]
        unsigned = {16: np.uint16, 32: np.uint32, 64: np.uint64}[layout.length]
        value = raw.astype(unsigned).view(width).astype(np.float64)
    else:
        value = raw.astype(np.float64)
        if layout.signed:
            value[raw >> np.uint64(layout.length - 1) > 0] -= 2.0**layout.length
    if invalid := field.invalid | no_value:
        value[np.isin(raw, np.array(sorted(invalid), dtype=np.uint64))] = np.nan
    means = bin_means(log.time_s, value, edges)
    step = np.diff(value)
    known = np.isfinite(step)
    rms = float(np.sqrt(np.mean(step[known] ** 2))) if known.any() else 0.0
    return Series(field, "value", means, period_s=log.period_s, no_value=no_value, step_rms=rms)


def _no_value_number(raw: RawArray) -> frozenset[int]:
    """Return the greatest number if it is all ones and far above all others: by custom it means that there is
    no value. Else an empty set.
    """
    greatest = int(raw.max()) if len(raw) else 0
    if greatest < SETTINGS.min_reserved_value or greatest & (greatest + 1):
        return frozenset()
    others = raw[raw != greatest]
    apart = len(others) > len(raw) // 2 and int(others.max()) < SETTINGS.reserved_apart * greatest
    return frozenset({greatest}) if apart else frozenset()


def as_count(field: MessageField, log: MessageLog, raw: RawArray, edges: FloatArray) -> Series | None:
    """Return the field as a counter that rolls over; None if its steps are not those of one."""
    counter = unwrap(field, log, raw)
    if counter is None:
        return None
    time_s = counter.time_s
    rate = np.diff(np.interp(edges, time_s, counter.counts)) / np.diff(edges)
    inside = (edges >= time_s[0]) & (edges <= time_s[-1])
    known = inside[1:] & inside[:-1]
    return Series(
        field,
        "count",
        np.where(known, rate, np.nan),
        counter.modulus,
        counter.modulus_seen,
        log.period_s,
        no_value=counter.no_value,
    )


def unwrap(field: MessageField, log: MessageLog, raw: RawArray) -> Counter | None:
    """Return the counts of a field that rolls over; None if its steps are not those of a counter."""
    if field.layout.length < 4 or len(raw) < 20:
        return None
    time_s, number = log.time_s, raw
    if field.invalid:
        time_s, number = _without_numbers(field.invalid, time_s, number)
    reserved = _reserved_numbers(number)
    if reserved:
        time_s, number = _without_numbers(reserved, time_s, number)
    if len(number) < 20:
        return None
    whole = 2.0 ** min(field.layout.length, 62)
    value = (number % np.uint64(1 << 62)).astype(np.float64)
    step = np.diff(value)
    span = float(value.max()) + 1.0
    wrapped = step < -0.5 * span
    if not counts_up(step[~wrapped]):
        return None
    jitter = _encoder_jitter(step[~wrapped])
    modulus, seen = _estimated_modulus(step, wrapped, wrapped | (step > span - 1.0 - jitter), span, whole)
    if (wrong := _corrupt_frames(step, modulus)).any():
        time_s, value = time_s[~wrong], value[~wrong]
        step = np.diff(value)
    step = np.where(step < -0.5 * modulus, step + modulus, step)
    step = np.where(step > modulus - jitter, step - modulus, step)
    gap = np.diff(time_s)
    long = gap > SETTINGS.long_gap_periods * log.period_s
    if long.any():
        # How often it rolled over in a gap follows from the speed before and after.
        typical = np.interp(time_s[:-1], time_s[:-1][~long], (step / np.maximum(gap, 1e-6))[~long])
        step = step + np.where(long, modulus * np.rint((typical * gap - step) / modulus), 0.0)
    counts = np.concatenate([[0.0], np.cumsum(step)])
    often = frozenset(number for number, times in reserved.items() if times >= SETTINGS.few_reserved)
    return Counter(time_s, counts, round(modulus), seen, often)


def _without_numbers(
    numbers: Iterable[int], time_s: FloatArray, raw: RawArray
) -> tuple[FloatArray, RawArray]:
    """Return stamps and raw numbers of the frames that carry none of `numbers`."""
    kept = ~np.isin(raw, np.array(sorted(numbers), dtype=np.uint64))
    return time_s[kept], raw[kept]


def _reserved_numbers(raw: RawArray) -> dict[int, int]:
    """Return the greatest numbers of a counter that are none of its counts, and how often each comes.

    A count is reached from the counts just below it, and left for those just above it or past the roll-over;
    a number for "no value" is reached from anywhere. Without this it would pass for the modulus.
    """
    found: dict[int, int] = {}
    value = raw.astype(np.float64)
    while len(value) >= 20 and len(found) < SETTINGS.most_reserved:
        step = np.diff(value)
        if not (step > 0).any():
            break
        limit = SETTINGS.reached_steps * float(np.percentile(step[step > 0], 95.0))
        greatest = float(value.max())
        at_top = value == greatest
        entered, left = at_top[1:] & ~at_top[:-1], at_top[:-1] & ~at_top[1:]
        afar = np.concatenate([step[entered] > limit, value[1:][left] > limit])
        if not len(afar) or afar.mean() <= 0.5 or at_top.mean() > 0.5:
            break
        found[int(greatest)] = int(at_top.sum())
        value = value[~at_top]
    return found


def counts_up(step: FloatArray) -> bool:
    """Return whether steps, roll-overs left out, are a counter's: some forward, hardly one back."""
    return (step > 0).sum() >= 20 and bool((step < -_encoder_jitter(step)).mean() <= SETTINGS.backward_steps)


def _encoder_jitter(step: FloatArray) -> float:
    """Return the largest step back of an encoder at rest, in counts; 0 to 1 for toothed rings, which cannot
    go back."""
    return SETTINGS.encoder_jitter * float(np.median(step[step > 0]))


def _corrupt_frames(step: FloatArray, modulus: float) -> NDArray[np.bool_]:
    """Return (n,) True for single frames far off the counts of both neighbours, which themselves agree."""
    around = (step + 0.5 * modulus) % modulus - 0.5 * modulus
    wrong = np.zeros(len(step) + 1, dtype=np.bool_)
    limit = SETTINGS.corrupt_steps * float(np.percentile(np.abs(around), 99.0))
    if 2.0 * limit < 0.5 * modulus:
        apart = np.abs(around) > limit
        both = np.abs((around[:-1] + around[1:] + 0.5 * modulus) % modulus - 0.5 * modulus)
        wrong[1:-1] = apart[:-1] & apart[1:] & (both <= 2.0 * limit)
    return wrong


def _estimated_modulus(
    step: FloatArray,
    wrapped: NDArray[np.bool_],
    both_directions: NDArray[np.bool_],
    span: float,
    whole: float,
) -> tuple[float, bool]:
    """Return the modulus of a counter, and True if it is certain: a roll-over's step falls short of its
    neighbours' by just that.

    `both_directions` (n,): roll-overs, and those back through zero.
    """
    at = np.flatnonzero(wrapped)
    at = at[(at > 0) & (at < len(step) - 1)]
    at = at[~both_directions[at - 1] & ~both_directions[at + 1]] if len(at) else at
    if len(at) < SETTINGS.few_wraps:
        return whole, False
    missing = 0.5 * (step[at - 1] + step[at + 1]) - step[at]
    centre = float(np.median(missing))
    spread = 1.4826 * float(np.median(np.abs(missing - centre)))
    std = max(1.2533 * spread, SETTINGS.step_std) / np.sqrt(len(at))
    if abs(centre - whole) < max(4.0 * std, 0.5):
        return whole, True
    # A power of two below the field's width: the bits above never change.
    power = 2.0 ** np.ceil(np.log2(span))
    if abs(centre - power) < max(4.0 * std, 0.5):
        return float(power), True
    return max(float(np.rint(centre)), span), std < 0.2
