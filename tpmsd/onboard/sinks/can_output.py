"""`[[can.output]]`: messages in a car's own format, filled with values of the monitor.

In: the configuration, DBCs, reports, and which frames others send. Out: frames per bus. Nothing is sent whose
identifier is not on the allow-list `[can] output_ids`; nothing before the bus was listened to for `LISTEN_S`;
and nothing ever again, until the daemon is restarted, under an identifier that another node sends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cantools.database.can import Database, Message, Signal

from tpmsd.car.config.dbc import load_dbc
from tpmsd.car.config.model import CanConfig, Config, OutputConfig, OutputSignal
from tpmsd.car.config.output_names import CHECKSUM, COUNTER, DISCRETE
from tpmsd.car.config.problems import ConfigProblems
from tpmsd.foundation.errors import ConfigError
from tpmsd.onboard.monitor.records import MonitorReport
from tpmsd.onboard.sinks.can_frames import Cycle, OutFrame
from tpmsd.onboard.sinks.checksums import ALGORITHMS
from tpmsd.onboard.sinks.j1939 import j1939_frames, j1939_identifier
from tpmsd.onboard.sinks.output_values import output_values
from tpmsd.onboard.sources.can.signal_plan import can_filters

LISTEN_S = 3.0
"""Time of listening for other senders, s: relevant messages of a running car come more often, and a lamp need
not wait longer."""
CHANGE_GAP_S = 0.02
"""Shortest time between two changes that are sent, s."""


@dataclass(slots=True)
class Output:
    """One message that is to be sent."""

    label: str
    bus: int
    """Number of the bus: 0 for that of [can], else the further bus."""
    identifier: int
    extended: bool
    make: Callable[[Mapping[str, float], int], list[bytes]]
    """Function of values and counter that returns the data of each frame."""
    watched: frozenset[str]
    """Values whose change is sent."""
    cycle: Cycle | None
    on_change: bool
    counter: int = 0
    sent: int = 0
    stopped: str = ""
    last_sent: tuple[float, ...] = field(default=())
    last_sent_s: float = -math.inf


class CanOutputs:
    """Outputs of one daemon."""

    def __init__(self, config: Config, database: Database) -> None:
        """Raises ConfigError for a message, signal or identifier that does not fit."""
        can, alarms = config.can, config.alarms
        self._outputs = [_make_output(can, number, output) for number, output in enumerate(can.output, 1)]
        own = {alarms.status_id, alarms.alarm_id} if alarms.can else set()
        for out in self._outputs:
            read = {(one["extended"], one["can_id"]) for one in can_filters(config, database, out.bus)}
            if (out.extended, out.identifier) in read:
                raise ConfigError(
                    f"[[can.output]] {out.label}: tpmsd reads 0x{out.identifier:X} from the car itself"
                )
            if out.extended == alarms.extended_ids and out.identifier in own:
                raise ConfigError(
                    f"[[can.output]] {out.label}: 0x{out.identifier:X} is a frame of [alarms] already"
                )
        self._watched = {(out.bus, out.extended, out.identifier): out for out in self._outputs}
        if len(self._watched) < len(self._outputs):
            raise ConfigError("[[can.output]]: two outputs have the same identifier on the same bus")
        self._since_s: float | None = None

    def __bool__(self) -> bool:
        return bool(self._outputs)

    def filters(self, bus: int) -> list[dict[str, Any]]:
        """Return the CAN filters that let other nodes' frames under the outputs' identifiers through."""
        return [
            {
                "can_id": out.identifier,
                "can_mask": 0x1FFFFFFF if out.extended else 0x7FF,
                "extended": out.extended,
            }
            for out in self._outputs
            if out.bus == bus
        ]

    def received(self, bus: int, identifier: int, extended: bool) -> str:
        """Process a frame of another node; return a line for the log if that stops an output, else
        nothing."""
        out = self._watched.get((bus, extended, identifier))
        if out is None or out.stopped:
            return ""
        out.stopped = f"another node sends 0x{identifier:X}"
        return f"[[can.output]] {out.label} is stopped: {out.stopped}"

    def frames(self, now_s: float, report: MonitorReport) -> dict[int, list[OutFrame]]:
        """Return the frames due at `now_s` by bus number; call once per tick."""
        if not self._outputs:
            return {}
        if self._since_s is None or now_s < self._since_s:
            self._since_s = now_s
        if now_s - self._since_s < LISTEN_S:
            return {}
        values = output_values(report)
        due: dict[int, list[OutFrame]] = {}
        for out in self._outputs:
            if out.stopped:
                continue
            now = tuple(values[name] for name in sorted(out.watched))
            changed = (
                out.on_change and now != out.last_sent and not 0.0 <= now_s - out.last_sent_s < CHANGE_GAP_S
            )
            if not (changed or (out.cycle is not None and out.cycle.due(now_s))):
                continue
            out.last_sent, out.last_sent_s = now, now_s
            for data in out.make(values, out.counter):
                due.setdefault(out.bus, []).append(OutFrame(out.identifier, out.extended, data))
                out.sent += 1
            out.counter += 1
        return due

    def status(self) -> list[dict[str, Any]]:
        """Return the values for the status document."""
        return [
            {
                "message": out.label,
                "id": out.identifier,
                "bus": out.bus,
                "sent": out.sent,
                "stopped": out.stopped,
            }
            for out in self._outputs
        ]


def _make_output(can: CanConfig, number: int, output: OutputConfig) -> Output:
    """Return the output of one table of the configuration; ConfigError if it does not fit."""
    where = f"[[can.output]] {number}"
    bus = 0
    if output.bus is not None:
        if output.bus not in can.buses:
            raise ConfigError(f"{where}: bus: no such bus {output.bus!r} (allowed: an entry of [can.buses])")
        bus = 1 + list(can.buses).index(output.bus)
    watched = frozenset(signal.value for _, signal in output.signals if signal.value in DISCRETE)
    make: Callable[[Mapping[str, float], int], list[bytes]]
    if output.j1939 is not None:
        kind = output.j1939
        identifier, extended, label = (
            j1939_identifier(kind, output.source_address or 0),
            True,
            f"j1939 {kind}",
        )
        watched = DISCRETE

        def make(values: Mapping[str, float], _: int) -> list[bytes]:
            return j1939_frames(kind, values)
    else:
        dbc = output.dbc or (can.dbc if bus == 0 else list(can.buses.values())[bus - 1].dbc)
        message = _load_message(where, dbc, output.message or "")
        identifier, extended, label = message.frame_id, message.is_extended_frame, message.name
        filler = _Filler(where, message, output)
        make = filler.data
    if identifier not in can.output_ids:
        allowed = "[can] output_ids, the list of what may be sent"
        raise ConfigError(f"{where}: {label}: 0x{identifier:X} is not in {allowed}")
    cyclic = output.when in ("cyclic", "both")
    cycle = Cycle(output.period_s) if cyclic else None
    return Output(label, bus, identifier, extended, make, watched, cycle, output.when != "cyclic")


def _load_message(where: str, dbc: Path, name: str) -> Message:
    """Return a message of a DBC; ConfigError if there is none or it cannot be filled."""
    try:
        database: Database = load_dbc(dbc)
    except ConfigProblems as error:
        raise ConfigError(f"{where}: {error}") from None
    try:
        message = database.get_message_by_name(name)
    except KeyError:
        raise ConfigError(f"{where}: message: {dbc.name} has no message {name!r}") from None
    if message.is_multiplexed():
        raise ConfigError(f"{where}: message: {name} is multiplexed; such messages are not filled")
    if message.length > 8:
        raise ConfigError(f"{where}: message: {name} is longer than 8 bytes; such messages are not filled")
    return message


class _Filler:
    """Fills one message."""

    def __init__(self, where: str, message: Message, output: OutputConfig) -> None:
        self._message = message
        self._given: list[tuple[Signal, OutputSignal]] = []
        for name, value in output.signals:
            try:
                signal = message.get_signal_by_name(name)
            except KeyError:
                raise ConfigError(f"{where}: signals: {message.name} has no signal {name!r}") from None
            self._given.append((signal, value))
        self._rest = {
            signal.name: _physical_value(signal, signal.raw_initial or 0) for signal in message.signals
        }
        self._checksums = [(s, o) for s, o in self._given if o.value == CHECKSUM]
        for signal, _ in self._checksums:
            first = signal.start if signal.byte_order == "little_endian" else signal.start - 7
            if signal.length != 8 or first % 8:
                raise ConfigError(f"{where}: signals.{signal.name}: a checksum is one whole byte")
        if len(self._checksums) > 1:
            raise ConfigError(f"{where}: signals: two checksums")

    def data(self, values: Mapping[str, float], counter: int) -> list[bytes]:
        """Return the data of the frame, in a list of one, with counter and checksum."""
        filled = dict(self._rest)
        for signal, option in self._given:
            if option.value != CHECKSUM:
                filled[signal.name] = _limit_to_signal(
                    signal, self._signal_value(signal, option, values, counter)
                )
        data = bytearray(self._message.encode(filled, strict=False))
        for signal, option in self._checksums:
            at = signal.start // 8
            identifier = self._message.frame_id
            others = bytes(option.data_id) + bytes(data[:at] + data[at + 1 :])
            data[at] = ALGORITHMS[option.algorithm or ""](identifier, others, len(data))
        return [bytes(data)]

    @staticmethod
    def _signal_value(
        signal: Signal, option: OutputSignal, values: Mapping[str, float], counter: int
    ) -> float:
        """Return the physical value of a signal by its option: constant, counter, or a value of the
        monitor."""
        if option.value is None:
            return option.constant
        if option.value == COUNTER:
            return _physical_value(signal, counter % (option.modulo or 1 << signal.length))
        value = values[option.value]
        if math.isnan(value):
            return (
                _physical_value(signal, signal.raw_initial or 0) if option.unknown is None else option.unknown
            )
        if option.mapped:
            return option.mapped[min(max(int(value), 0), len(option.mapped) - 1)]
        return value


def _physical_value(signal: Signal, raw: float) -> float:
    """Return the physical value of a raw one."""
    return float(raw * signal.scale + signal.offset)


def _limit_to_signal(signal: Signal, value: float) -> float:
    """Return the value limited to what the signal's bits can hold and to the DBC's limits."""
    if signal.is_float:
        return value
    low = -(1 << (signal.length - 1)) if signal.is_signed else 0
    high = low + (1 << signal.length) - 1
    ends = sorted((_physical_value(signal, low), _physical_value(signal, high)))
    if signal.minimum is not None and signal.maximum is not None and signal.minimum < signal.maximum:
        ends = [max(ends[0], float(signal.minimum)), min(ends[1], float(signal.maximum))]
    return min(max(value, ends[0]), ends[1])
