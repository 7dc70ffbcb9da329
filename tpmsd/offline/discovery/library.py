"""The car library: which signals known platforms use.

In: the tables of `cars/*.toml`, the fields of a bus. Out: `CarPlatform`s; the `Match` with a bus.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tpmsd.car.config.model import ROLES
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.discovery.raw_fields import dbc_start
from tpmsd.offline.discovery.series import MessageField
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT, EXTENDED, bit_position


@dataclass(frozen=True, slots=True)
class CarPlatform:
    """One platform: facts of its bus alone."""

    name: str
    title: str
    dbc: str
    """File of the public collection that describes the bus."""
    signals: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Role -> the table form of a signal, with `id`, `start`, `bits` and what else decodes it without a
    DBC."""
    teeth_per_rev: float | None = None

    def signal_names(self) -> dict[str, str]:
        """Return a mapping role -> 'Message.Signal', wheels only."""
        return {role: str(entry["signal"]) for role, entry in self._wheel_entries().items()}

    def fields_by_wheel(self) -> dict[str, MessageField]:
        """Return a mapping wheel (`fl fr rl rr`) -> field of its signal."""
        return {role[-2:]: field_of(entry) for role, entry in self._wheel_entries().items()}

    def _wheel_entries(self) -> dict[str, Mapping[str, Any]]:
        return {role: entry for role, entry in self.signals.items() if role.startswith("wheel_")}


def car_from(name: str, data: Mapping[str, Any]) -> CarPlatform:
    """Return one entry by its file's name and tables; ConfigError on what makes no sense."""
    known = {"title", "dbc", "teeth_per_rev", "signals"}
    if unknown := sorted(set(data) - known):
        raise ConfigError(f"car {name}: unknown key {unknown[0]}")
    signals = data.get("signals", {})
    for role, entry in signals.items():
        if role not in ROLES or not isinstance(entry, Mapping):
            raise ConfigError(f"car {name}: {role} is no role with a signal")
        if missing := [key for key in ("signal", "id", "start", "bits") if key not in entry]:
            raise ConfigError(f"car {name}: {role} has no {missing[0]}")
    if not any(role.startswith("wheel_") for role in signals):
        raise ConfigError(f"car {name}: no wheel signals")
    teeth = data.get("teeth_per_rev")
    return CarPlatform(name, str(data.get("title", name)), str(data.get("dbc", "")), signals, teeth)


def field_of(entry: Mapping[str, Any]) -> MessageField:
    """Return the field that an entry's facts describe."""
    message, _, name = str(entry["signal"]).partition(".")
    big = bool(entry.get("big_endian", False))
    layout = bit_position(int(entry["start"]), int(entry["bits"]), big, bool(entry.get("signed", False)))
    key = int(entry["id"]) | (EXTENDED if entry.get("extended") else 0)
    scale, offset = float(entry.get("scale", 1.0)), float(entry.get("offset", 0.0))
    return MessageField(message, name, key, layout, scale, offset, str(entry.get("unit", "")))


@dataclass(frozen=True, slots=True)
class Match:
    """A platform whose bus this one looks like."""

    car: CarPlatform
    wheels: Mapping[str, str]
    """Wheel -> 'Message.Signal' of this bus."""
    by_name: bool
    """True if the signals bear the platform's names, too; else they lie where its signals lie."""


def match_car(cars: Sequence[CarPlatform], fields: Sequence[MessageField]) -> Match | None:
    """Return the platform whose wheel signals are all on this bus, by name and layout or by layout alone.

    `fields`: those of the DBC whose messages are in the log. A name alone is no match: makers call different
    messages alike.
    """
    matches = [match for car in cars if (match := _match_platform(car, fields)) is not None]
    return max(matches, key=lambda match: (match.by_name, len(match.car.signals)), default=None)


def _match_platform(car: CarPlatform, fields: Sequence[MessageField]) -> Match | None:
    """Return the match of a platform; None where one of its wheel signals is not on the bus."""
    names = {role[-2:]: name for role, name in car.signal_names().items()}
    wheels = {}
    for wheel, expected in car.fields_by_wheel().items():
        here = [one.signal for one in fields if _same_bits(one, expected)]
        if not here:
            return None
        wheels[wheel] = here[0]
    return Match(car, wheels, wheels == names)


def _same_bits(one: MessageField, other: MessageField) -> bool:
    """Return whether two fields lie in the same bits of the same message."""
    same = (one.key ^ other.key) & (1 << BUS_SHIFT) - 1 == 0
    return same and _bit_position(one) == _bit_position(other)


def _bit_position(one: MessageField) -> tuple[bool, int, int]:
    return one.layout.big_endian, one.layout.length, dbc_start(one)
