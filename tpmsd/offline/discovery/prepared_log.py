"""A drive prepared for questions: the receiver's reference, and every field read as it could be meant.

In: frames, fixes, a DBC where there is one. Out: `PreparedLog`.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from cantools.database.can import Database

from tpmsd.car.config.dbc import counter_modulus
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.frames import BusLog, MessageLog
from tpmsd.offline.discovery.other_roles import find_gyro
from tpmsd.offline.discovery.raw_fields import raw_fields
from tpmsd.offline.discovery.reference import ReceiverMotion, make_reference
from tpmsd.offline.discovery.series import MessageField, Series, as_count, as_value, counts_up
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.onboard.sources.can.signal_bits import RawArray
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT, EXTENDED, bit_field, invalid_bits, selector_chain
from tpmsd.onboard.sources.events import GnssFix


@dataclass(frozen=True, slots=True)
class PreparedLog:
    """A drive, prepared; `check --drive` asks it more than one question."""

    reference: ReceiverMotion
    logs: dict[int, MessageLog]
    series: list[Series]
    frames: int
    has_dbc: bool
    gyro: FloatArray | None = None
    channels: tuple[str, ...] = ()
    """Names of the log's buses by number."""


def prepare(
    log: BusLog, fixes: Sequence[GnssFix], database: Database | None, settings: Settings = SETTINGS
) -> PreparedLog:
    """Compute the receiver's reference, and read every field both as a value and, where it counts, as a
    counter.
    """
    reference = make_reference(fixes, settings)
    logs = log.messages()
    edges = reference.edge_s
    fields = dbc_fields(database, logs) if database is not None else _raw_wheel_fields(logs, settings)
    series: list[Series] = []
    for one in fields:
        try:
            message = logs[one.key].selected(one.selectors)
            raw = message.bits(one.layout)
        except ValueError:
            continue
        if len(raw) < 10 or raw.min() == raw.max() or len(edges) < 3:
            continue
        if database is None and not _may_be_wheel(message, raw, reference):
            continue
        series.append(as_value(one, message, raw, edges))
        if not one.layout.is_float and message.period_s * settings.min_rate_hz <= 1.0:
            counted = as_count(one, message, raw, edges)
            if counted is not None:
                series.append(counted)
    gyro = find_gyro(series, reference, settings) if database is not None else None
    return PreparedLog(reference, logs, series, log.frames, database is not None, gyro, tuple(log.channels))


def _may_be_wheel(log: MessageLog, raw: RawArray, reference: ReceiverMotion) -> bool:
    """Return whether the number of a field of raw frames correlates with the speed, or counts up, by a quick
    check.
    """
    at = np.searchsorted(log.time_s, reference.edge_s[:: max(1, len(reference.edge_s) // 400)])
    at = at[(at > 0) & (at < len(raw))]
    speed = np.interp(log.time_s[at], reference.edge_s[:-1], np.nan_to_num(reference.speed_mps))
    value = raw[at].astype(np.float64)
    if len(at) > 20 and np.ptp(value) > 0:
        ranks = [np.argsort(np.argsort(x)) for x in (value, speed)]
        if np.corrcoef(ranks[0], ranks[1])[0, 1] > 0.7:
            return True
    sample = np.arange(0, len(raw) - 1, 1 + len(raw) // SETTINGS.glance_steps)
    step = raw[sample + 1].astype(np.float64) - raw[sample].astype(np.float64)
    moves = step[step != 0]
    return counts_up(moves[moves > -0.5 * (float(raw.max()) + 1.0)])


def dbc_fields(database: Database, logs: Mapping[int, MessageLog]) -> list[MessageField]:
    """Return every signal of the DBC whose message is in the log, on each bus that carries it."""
    found = []
    here: dict[int, list[int]] = {}
    for key in logs:
        here.setdefault(key & (1 << BUS_SHIFT) - 1, []).append(key)
    for message in database.messages:
        keys = here.get(message.frame_id | (EXTENDED if message.is_extended_frame else 0), [])
        for key, signal in itertools.product(keys, message.signals):
            try:
                layout, selectors = bit_field(signal), selector_chain(message, signal)
            except ConfigError:
                continue
            scale, offset = float(signal.scale), float(signal.offset)
            if scale:
                found.append(
                    MessageField(
                        message.name,
                        signal.name,
                        key,
                        layout,
                        scale,
                        offset,
                        signal.unit or "",
                        invalid_bits(signal, layout),
                        0 if layout.is_float else counter_modulus(signal),
                        selectors,
                    )
                )
    return found


def _raw_wheel_fields(logs: Mapping[int, MessageLog], settings: Settings) -> list[MessageField]:
    """Return the runs of bits of the messages that come often enough to carry wheels."""
    return [
        one for log in logs.values() if log.period_s * settings.min_rate_hz <= 1.0 for one in raw_fields(log)
    ]
