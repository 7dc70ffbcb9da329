"""The car library: which signals known platforms use.

In: the tables of `cars/*.toml`, a DBC. Out: `Car`s; the one that fits a bus.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cantools.database.can import Database

from tpmsd.config.model import ROLES
from tpmsd.errors import ConfigError
from tpmsd.sources.signal_plan import EXTENDED


@dataclass(frozen=True, slots=True)
class Car:
    """One platform: facts of its bus alone."""

    name: str
    title: str
    dbc: str
    """File of the public collection that describes the bus."""
    signals: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Role -> the table form of a signal, with `id`, `start`, `bits`, ... where it can be decoded without
    a DBC."""
    teeth_per_rev: float | None = None

    def signal_names(self) -> dict[str, str]:
        """Role -> 'Message.Signal', wheels only."""
        return {
            role: str(entry["signal"]) for role, entry in self.signals.items() if role.startswith("wheel_")
        }


def car_from(name: str, data: Mapping[str, Any]) -> Car:
    """One entry by its file's name and tables; ConfigError on what makes no sense."""
    known = {"title", "dbc", "teeth_per_rev", "signals"}
    if unknown := sorted(set(data) - known):
        raise ConfigError(f"car {name}: unknown key {unknown[0]}")
    signals = data.get("signals", {})
    for role, entry in signals.items():
        if role not in ROLES or not isinstance(entry, Mapping) or "signal" not in entry:
            raise ConfigError(f"car {name}: {role} is no role with a signal")
    if not any(role.startswith("wheel_") for role in signals):
        raise ConfigError(f"car {name}: no wheel signals")
    teeth = data.get("teeth_per_rev")
    return Car(name, str(data.get("title", name)), str(data.get("dbc", "")), signals, teeth)


def match_car(cars: Sequence[Car], database: Database, seen: Collection[int]) -> Car | None:
    """The entry whose wheel signals are all in the DBC, and their messages in the log."""
    keys = {
        f"{message.name}.{signal.name}": message.frame_id | (EXTENDED if message.is_extended_frame else 0)
        for message in database.messages
        for signal in message.signals
    }
    fitting = [car for car in cars if all(keys.get(name, -1) in seen for name in car.signal_names().values())]
    return max(fitting, key=lambda car: len(car.signals), default=None)
