"""Plan of the signals, made from the DBC: frame, bits and conversion to SI units of each signal that is
needed.

In: `Config` and a cantools database. Out: one `MessagePlan` per arbitration id that carries a needed signal,
and the CAN filters for exactly those ids. Pure.

cantools decodes whole messages into dictionaries, choices and all; at bus speed that is too slow by a factor
of ten. Here the frame becomes one integer per byte order, and each signal is a shift and a mask of it.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from cantools.database.can import Database, Message, Signal

from tpmsd.car.config.dbc import counter_modulus
from tpmsd.car.config.model import WHEEL_COUNT_ROLES, WHEEL_SPEED_ROLES, Condition, Config
from tpmsd.car.config.units import to_si, wheel_speed_kind
from tpmsd.foundation.errors import ConfigError
from tpmsd.onboard.sources.can.databases import database_of

EXTENDED = 1 << 31
"""Marks a 29-bit identifier in a plan's key, as SocketCAN marks it on the wire."""
REVERSE_ROLE = "reverse_gear"
"""While this flag is set, wheel signals without a sign turn backward."""
BUS_SHIFT = 32
"""A plan's key holds the number of its bus (0: that of [can]) above the identifier."""

_FLOATS = {16: struct.Struct(">e"), 32: struct.Struct(">f"), 64: struct.Struct(">d")}


@dataclass(frozen=True, slots=True)
class BitField:
    """Bits of a frame as a shift and a mask of the frame read as one integer in the signal's byte order."""

    big_endian: bool
    min_bytes: int
    """Shortest frame that holds all bits."""
    length: int
    shift: int
    """Right shift of the first `word_bytes` bytes read as an integer."""
    word_bytes: int
    """Bytes that the integer spans; `min_bytes`, or more once it shares its integer with other signals."""
    signed: bool
    is_float: bool
    mask: int
    """`length` ones."""

    def bits(self, data: bytes) -> int:
        """Return the raw bits, unsigned. `data` has at least `min_bytes` bytes."""
        word = data[: self.word_bytes]
        if self.big_endian:
            return (int.from_bytes(word.ljust(self.word_bytes, b"\0"), "big") >> self.shift) & self.mask
        return (int.from_bytes(word, "little") >> self.shift) & self.mask

    def number(self, bits: int) -> float:
        """Return the number in raw bits: an integer (two's complement if signed) or an IEEE 754 number."""
        if self.is_float:
            packer = _FLOATS[self.length]
            return float(packer.unpack(bits.to_bytes(packer.size, "big"))[0])
        if self.signed and bits >> (self.length - 1):
            return bits - (1 << self.length)
        return bits


@dataclass(frozen=True, slots=True)
class SignalPlan:
    """Bits of a frame that a role is read from, and how they become an SI value."""

    role: str
    signal: str
    """'Message.Signal'."""
    field: BitField
    gain: float
    bias: float
    """SI value = gain * number + bias; wheel speeds in rad/s. For counters gain is counts per bit, always
    positive, and bias 0."""
    invalid: frozenset[int]
    """Raw bits that mean 'no value'."""
    modulus: int = 0
    """A counter's values are 0 to modulus - 1; 0 for what is no counter."""
    valid_when: int | None = None
    """Number of the condition (`ConditionPlan.number`) without which the value is not to be used."""
    backward_when: int | None = None
    """Number of the condition under which the wheel turns backward."""

    @property
    def wheel(self) -> int | None:
        """Index of the wheel, None for the other roles."""
        for roles in (WHEEL_COUNT_ROLES, WHEEL_SPEED_ROLES):
            if self.role in roles:
                return roles.index(self.role)
        return None


@dataclass(frozen=True, slots=True)
class SignalGroup:
    """The needed signals of one message that are sent together: all in the same multiplexer branch."""

    name: str
    selectors: tuple[tuple[BitField, frozenset[int]], ...]
    """Outermost first: the group is in the frame if every field holds one of its numbers."""
    signals: tuple[SignalPlan, ...]


@dataclass(frozen=True, slots=True)
class ConditionPlan:
    """A comparison of one signal with a number."""

    number: int
    name: str
    selectors: tuple[tuple[BitField, frozenset[int]], ...]
    field: BitField
    gain: float
    bias: float
    operator: str
    value: float

    def holds(self, bits: int) -> bool:
        """Return whether the raw bits meet the comparison."""
        found = self.gain * self.field.number(bits) + self.bias
        # Physical values are products of decimal fractions: equal means within rounding.
        equal = abs(found - self.value) <= 1e-9 * max(1.0, abs(self.value))
        if self.operator in ("==", "!="):
            return equal == (self.operator == "==")
        if equal:
            return "=" in self.operator
        return found > self.value if ">" in self.operator else found < self.value


@dataclass(frozen=True, slots=True)
class MessagePlan:
    """The needed signals of one arbitration id."""

    key: int
    """Arbitration id, with `EXTENDED` set for 29-bit ones and the number of the bus above `BUS_SHIFT`."""
    name: str
    little_bytes: int
    big_bytes: int
    """Bytes that the two integers of a frame span; 0 where no signal has that byte order."""
    groups: tuple[SignalGroup, ...]
    conditions: tuple[ConditionPlan, ...] = ()
    """Comparisons of this message's signals."""


def needed_signals(config: Config) -> dict[str, str]:
    """Return a mapping role -> 'Message.Signal' of the decoded signals; a wheel with a counter needs no speed
    signal."""
    counted = {f"wheel_speed_{role[-2:]}" for role in WHEEL_COUNT_ROLES if role in config.can.signals}
    return {role: signal for role, signal in config.can.signals.items() if role not in counted}


def compile_plans(config: Config, database: Database) -> dict[int, MessagePlan]:
    """Return the plan of each message by its key (bus and identifier). A `ConfigError` names the role whose
    message, signal or unit does not fit."""
    found: dict[int, tuple[Message, list[tuple[Signal, SignalPlan]]]] = {}
    conditions = _ComparisonList(database)
    for role, name in needed_signals(config).items():
        bus = config.can.bus_number(role)
        message, signal = _find_signal(database_of(database, bus), role, name)
        plan = _signal_plan(config, role, name, signal)
        option = config.can.option(role)
        if option.valid_when is not None:
            plan = replace(plan, valid_when=conditions.index_of(bus, role, option.valid_when))
        if option.backward_when is not None:
            plan = replace(plan, backward_when=conditions.index_of(bus, role, option.backward_when))
        elif plan.wheel is not None and not plan.field.signed and REVERSE_ROLE in config.can.signals:
            engaged = Condition(config.can.signals[REVERSE_ROLE], "!=", 0.0)
            number = conditions.index_of(config.can.bus_number(REVERSE_ROLE), REVERSE_ROLE, engaged)
            plan = replace(plan, backward_when=number)
        found.setdefault(_plan_key(bus, message), (message, []))[1].append((signal, plan))
    for key, message in conditions.messages.items():
        found.setdefault(key, (message, []))
    return {
        key: _message_plan(key, message, signals, conditions.plans.get(key, []))
        for key, (message, signals) in found.items()
    }


def signal_steps(config: Config, database: Database) -> dict[str, float]:
    """Return a mapping role -> resolution of its signal in SI units; 0 for floating-point numbers."""
    return {
        signal.role: 0.0 if signal.field.is_float else abs(signal.gain)
        for plan in compile_plans(config, database).values()
        for group in plan.groups
        for signal in group.signals
    }


def _plan_key(bus: int, message: Message) -> int:
    """Return the key of a message: bus number, extended flag and identifier in one integer."""
    return bus << BUS_SHIFT | message.frame_id | (EXTENDED if message.is_extended_frame else 0)


class _ComparisonList:
    """Gathers the comparisons, each once."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._numbers: dict[tuple[int, Condition], int] = {}
        self.messages: dict[int, Message] = {}
        self.plans: dict[int, list[ConditionPlan]] = {}

    def index_of(self, bus: int, role: str, condition: Condition) -> int:
        """Return the index of a comparison on a bus, by which frames' results are kept; adds it if it is
        new."""
        known = self._numbers.get((bus, condition))
        if known is not None:
            return known
        number = self._numbers[bus, condition] = len(self._numbers)
        message, signal = _find_signal(database_of(self._database, bus), role, condition.signal)
        key = _plan_key(bus, message)
        self.messages[key] = message
        plan = ConditionPlan(
            number,
            condition.signal,
            selector_chain(message, signal),
            bit_field(signal),
            float(signal.scale),
            float(signal.offset),
            condition.operator,
            condition.value,
        )
        self.plans.setdefault(key, []).append(plan)
        return number


def can_filters(config: Config, database: Database, bus: int = 0) -> list[dict[str, Any]]:
    """Return python-can's filters that let through the ids of a bus with a needed signal alone."""
    return [
        {
            "can_id": key & 0x1FFFFFFF,
            "can_mask": 0x1FFFFFFF if key & EXTENDED else 0x7FF,
            "extended": bool(key & EXTENDED),
        }
        for key in sorted(compile_plans(config, database))
        if key >> BUS_SHIFT == bus
    ]


def bit_field(signal: Signal) -> BitField:
    """Return the position of a signal's bits, by the rules of DBC files (see the README of cantools).

    A little-endian signal starts at its least significant bit; a big-endian one at its most significant bit,
    counted in the saw-tooth order (bit 7 of byte 0 is 7, bit 7 of byte 1 is 15).
    """
    if signal.is_float and signal.length not in _FLOATS:
        raise ConfigError(f"signal {signal.name} is a floating-point number of {signal.length} bits")
    big = signal.byte_order == "big_endian"
    return bit_position(signal.start, signal.length, big, signal.is_signed, signal.is_float)


def bit_position(
    start: int, length: int, big_endian: bool, signed: bool = False, is_float: bool = False
) -> BitField:
    """Return the position of `length` bits whose first one a DBC calls `start`."""
    first = 8 * (start // 8) + 7 - start % 8 if big_endian else start
    end = first + length
    size = (end + 7) // 8
    shift = 8 * size - end if big_endian else first
    return BitField(big_endian, size, length, shift, size, signed, is_float, (1 << length) - 1)


def _find_signal(database: Database, role: str, name: str) -> tuple[Message, Signal]:
    """Return message and signal of a name 'Message.Signal'; ConfigError if the DBC has none."""
    message_name, dot, signal_name = name.partition(".")
    if not dot:
        raise ConfigError(f"can.signals.{role}: {name!r} is not of the form 'Message.Signal'")
    try:
        message = database.get_message_by_name(message_name)
    except KeyError:
        raise ConfigError(f"can.signals.{role}: the DBC has no message {message_name!r}") from None
    try:
        return message, message.get_signal_by_name(signal_name)
    except KeyError:
        raise ConfigError(
            f"can.signals.{role}: message {message_name} has no signal {signal_name!r}"
        ) from None


def _signal_plan(config: Config, role: str, name: str, signal: Signal) -> SignalPlan:
    """Return the plan of one signal; ConfigError if its unit, scale or modulus does not fit the role."""
    field = bit_field(signal)
    option = config.can.option(role)
    unit = signal.unit if option.unit is None else option.unit
    try:
        factor, offset = to_si(role, unit)
    except ConfigError as error:
        raise ConfigError(f"can.signals.{role}: {name}: {error}") from None
    scale = float(signal.scale if option.scale is None else option.scale)
    shift = float(signal.offset if option.offset is None else option.offset)
    modulus = 0
    if role in WHEEL_COUNT_ROLES:
        if field.is_float:
            raise ConfigError(f"can.signals.{role}: {name} is a floating-point number, not a counter")
        # A counter's offset cancels in differences, and its sign bit is just its highest bit.
        gain, bias, field = abs(scale), 0.0, replace(field, signed=False)
        gain *= config.vehicle.teeth_per_rev / config.vehicle.teeth(WHEEL_COUNT_ROLES.index(role))
        modulus = option.modulus or counter_modulus(signal)
        if modulus > 1 << field.length:
            raise ConfigError(
                f"can.signals.{role}: modulus {modulus} does not fit into the {field.length} bits of {name}"
            )
    else:
        gain, bias = option.sign * factor * scale, option.sign * (factor * shift) + offset
    if role in WHEEL_SPEED_ROLES and wheel_speed_kind(unit) == "linear":
        # The speed of the road divided by a radius that stays: what the maker's own radius hides in it
        # is a constant factor, which calibration takes up.
        radius_m = config.bus_radius_m(WHEEL_SPEED_ROLES.index(role))
        gain, bias = gain / radius_m, bias / radius_m
    if gain == 0.0:
        raise ConfigError(f"can.signals.{role}: {name} has the scale 0 in the DBC")
    invalid = invalid_bits(signal, field) | {number & field.mask for number in option.invalid}
    return SignalPlan(role, name, field, gain, bias, invalid, modulus)


_NO_VALUE = re.compile(
    r"(?<![a-z])(sna|n/?a|nan|invalid|undefined|unavailable|unknown|fault|failure|error"
    r"|(signal[ _]*)?not[ _]*(available|valid|defined))(?![a-z])"
)
_DENIED = re.compile(r"(?<![a-z])(no|not|non|without)[ _]*(error|fault|failure)")


def invalid_bits(signal: Signal, field: BitField) -> frozenset[int]:
    """Return the raw bits by which a sender marks the value as invalid.

    These are the named choices that say so, and the value reserved for it by custom (all ones; for signed
    signals the lowest number) where the DBC's own limits exclude it.
    """
    invalid = set()
    for raw, name in (signal.choices or {}).items():
        text = str(name).lower()
        if _NO_VALUE.search(text) and not _DENIED.search(text):
            invalid.add(int(raw) & field.mask)
    if not field.is_float:
        low, high = signal.minimum, signal.maximum
        custom = 1 << (field.length - 1) if signal.is_signed else field.mask
        number = custom - (1 << field.length) if signal.is_signed else custom
        physical = float(signal.scale) * number + float(signal.offset)
        # Half a step of tolerance: limits are printed with few digits.
        slack = 0.5 * abs(float(signal.scale))
        limited = low is not None and high is not None and low < high
        if limited and not float(low) - slack <= physical <= float(high) + slack:  # type: ignore[arg-type]
            invalid.add(custom)
    return frozenset(invalid)


def _message_plan(
    key: int, message: Message, signals: list[tuple[Signal, SignalPlan]], conditions: list[ConditionPlan]
) -> MessagePlan:
    """Return the plan of a message: its signals grouped by multiplexer branch, and its comparisons."""
    chains = [selector_chain(message, signal) for signal, _ in signals]
    fields = [plan.field for _, plan in signals] + [field for chain in chains for field, _ in chain]
    fields += [c.field for c in conditions] + [field for c in conditions for field, _ in c.selectors]
    little = max((field.min_bytes for field in fields if not field.big_endian), default=0)
    big = max((field.min_bytes for field in fields if field.big_endian), default=0)

    branches: dict[tuple[tuple[BitField, frozenset[int]], ...], list[SignalPlan]] = {}
    for (_, plan), chain in zip(signals, chains, strict=True):
        shared = tuple((_in_shared_word(field, little, big), numbers) for field, numbers in chain)
        branches.setdefault(shared, []).append(replace(plan, field=_in_shared_word(plan.field, little, big)))
    groups = tuple(
        SignalGroup(_branch_name(message.name, chain), chain, tuple(plans))
        for chain, plans in branches.items()
    )
    compared = tuple(
        replace(
            condition,
            field=_in_shared_word(condition.field, little, big),
            selectors=tuple((_in_shared_word(f, little, big), numbers) for f, numbers in condition.selectors),
        )
        for condition in conditions
    )
    return MessagePlan(key, message.name, little, big, groups, compared)


def selector_chain(message: Message, signal: Signal) -> tuple[tuple[BitField, frozenset[int]], ...]:
    """Return the chain of multiplexers above a signal, outermost first (extended multiplexing nests them)."""
    chain: list[tuple[BitField, frozenset[int]]] = []
    seen: set[str] = set()
    while signal.multiplexer_ids is not None:
        parent = signal.multiplexer_signal
        if parent is None or parent in seen:
            raise ConfigError(f"message {message.name}: the multiplexing of {signal.name} does not resolve")
        seen.add(parent)
        selector = message.get_signal_by_name(parent)
        chain.append((bit_field(selector), frozenset(int(number) for number in signal.multiplexer_ids)))
        signal = selector
    return tuple(reversed(chain))


def _in_shared_word(field: BitField, little: int, big: int) -> BitField:
    """Return the same bits as a field of the one integer that all signals of the message are read from."""
    if not field.big_endian:
        return replace(field, word_bytes=little)
    return replace(field, word_bytes=big, shift=field.shift + 8 * (big - field.word_bytes))


def _branch_name(message: str, chain: Iterable[tuple[BitField, frozenset[int]]]) -> str:
    """Return the message's name with its multiplexer values in brackets, if it has any."""
    branch = "/".join(",".join(str(number) for number in sorted(numbers)) for _, numbers in chain)
    return f"{message}[{branch}]" if branch else message
