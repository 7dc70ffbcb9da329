"""The signals of a drive as a configuration reads them.

In: the configuration, its DBCs, the frames. Out: per role its field, and the frames in which it counts: those
of its bus, of its branch of the multiplexers, and in which the condition holds that it is valid under.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from cantools.database.can import Database
from numpy.typing import NDArray

from tpmsd.car.config.dbc import counter_modulus, find_signal
from tpmsd.car.config.model import Config
from tpmsd.offline.discovery.frames import BusLog, MessageLog
from tpmsd.offline.discovery.series import MessageField
from tpmsd.onboard.sources.can.channels import bus_numbers
from tpmsd.onboard.sources.can.databases import database_of
from tpmsd.onboard.sources.can.signal_plan import (
    BUS_SHIFT,
    EXTENDED,
    ConditionPlan,
    bit_field,
    compile_plans,
    invalid_bits,
    selector_chain,
)


def configured_fields(config: Config, database: Database, log: BusLog) -> dict[str, MessageField]:
    """Return a mapping role -> field as the configuration reads it; its key is the log's, or one without
    frames where the message never came.
    """
    buses = _Buses(config, log)
    fields = {}
    for role, name in config.can.signals.items():
        option, bus = config.can.option(role), config.can.bus_number(role)
        message, signal = find_signal(database_of(database, bus), name)
        identifier = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
        unit = option.unit or signal.unit or ""
        if role.startswith("wheel_count_"):
            unit = f"modulus {option.modulus or counter_modulus(signal)}"
        layout = bit_field(signal)
        fields[role] = MessageField(
            message.name,
            signal.name,
            buses.key(bus, identifier),
            layout,
            float(signal.scale if option.scale is None else option.scale),
            float(signal.offset if option.offset is None else option.offset),
            unit,
            invalid_bits(signal, layout) | {number & layout.mask for number in option.invalid},
            selectors=selector_chain(message, signal),
        )
    return fields


def configured_frames(
    config: Config, database: Database, log: BusLog, fields: Mapping[str, MessageField]
) -> dict[str, MessageLog]:
    """Return a mapping role -> the frames in which its signal is valid; roles whose message never came are
    left out.
    """
    buses, logs = _Buses(config, log), log.messages(copies=True)
    conditions = {
        condition.number: (buses.key(key >> BUS_SHIFT, key & (1 << BUS_SHIFT) - 1), condition)
        for key, plan in compile_plans(config, database).items()
        for condition in plan.conditions
    }
    needed = {
        signal.role: signal.valid_when
        for plan in compile_plans(config, database).values()
        for group in plan.groups
        for signal in group.signals
        if signal.valid_when is not None
    }
    frames = {}
    for role, field in fields.items():
        if field.key not in logs:
            continue
        message = logs[field.key].selected(field.selectors)
        if role in needed:
            key, condition = conditions[needed[role]]
            kept = _condition_holds(condition, logs.get(key), message)
            message = MessageLog(message.key, message.time_s[kept], message.data[kept])
        frames[role] = message
    return frames


class _Buses:
    """Keys of a configuration as keys of a log."""

    def __init__(self, config: Config, log: BusLog) -> None:
        others = [bus.channel for bus in config.can.buses.values()]
        numbers = bus_numbers(log.channels, config.can.channel, others)
        # The configured channel first; a log of another name is taken all the same, as a replay takes it.
        order = sorted(range(len(log.channels)), key=lambda k: log.channels[k] != config.can.channel)
        self._of = {
            bus: [k for k in order if numbers[log.channels[k]] == bus] for bus in range(1 + len(others))
        }
        self._known = log.keys()

    def key(self, bus: int, identifier: int) -> int:
        """Return the key of a message in the log; where it never came, that of the bus itself."""
        keys = [number << BUS_SHIFT | identifier for number in self._of[bus]]
        return next((key for key in keys if key in self._known), (keys or [bus << BUS_SHIFT | identifier])[0])


def _condition_holds(
    condition: ConditionPlan, judged: MessageLog | None, message: MessageLog
) -> NDArray[np.bool_]:
    """Return (n,) True where the condition held when each frame came, by the last frame that states it."""
    if judged is None:
        return np.zeros(len(message.time_s), dtype=np.bool_)
    judged = judged.selected(condition.selectors)
    bits = judged.bits(condition.field)
    raw_values, which = np.unique(bits, return_inverse=True)
    holds = np.array([condition.holds(int(number)) for number in raw_values], dtype=np.bool_)[which]
    last = np.searchsorted(judged.time_s, message.time_s, side="right") - 1
    return np.where(last >= 0, holds[np.maximum(last, 0)], False) if len(holds) else last >= 0
