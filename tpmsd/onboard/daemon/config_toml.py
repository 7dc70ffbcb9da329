"""A configuration as TOML, so that a recording holds what the daemon really ran with.

In: `Config`, command-line options worked in. Out: text that `tpmsd.car.config.load` reads back to the same
values.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from tpmsd.car.config.model import BusConfig, CanConfig, Condition, Config
from tpmsd.foundation.wheels import WHEELS

_TABLES = (
    *("vehicle", "can", "gnss", "filter", "monitor", "tyre", "alarms", "status", "state", "calibration"),
    *("dynamics", "vehicle_state"),
)
"""All but what a replay does not do, [notify] and [obd] (it sends nothing), and the path of [physics]."""


def config_toml(config: Config, dbc: str) -> str:
    """Return the tables with all values; `dbc` is the name under which the DBC lies beside the file."""
    lines: list[str] = []
    for table in _TABLES:
        record = getattr(config, table)
        lines.append(f"[{table}]")
        texts = {field.name: _value(config, table, field.name, dbc) for field in dataclasses.fields(record)}
        lines += [f"{name} = {text}" for name, text in texts.items() if text is not None]
        lines.append("")
        if table == "can":
            lines.append("[can.signals]")
            lines += [f"{role} = {signal_toml(config.can, role)}" for role in config.can.signals]
            lines.append("")
            if config.can.buses:
                lines.append("[can.buses]")
                lines += [
                    f"{_quoted_key(name)} = {_bus_table(bus, dbc)}" for name, bus in config.can.buses.items()
                ]
                lines.append("")
    return "\n".join(lines)


def _value(config: Config, table: str, name: str, dbc: str) -> str | None:
    """Return the text of a key's value; None where the key is left out."""
    value: object = getattr(getattr(config, table), name)
    if name in ("teeth_by_wheel", "output", "output_ids"):  # a replay sends nothing
        return None
    if name == "dbc":
        value = dbc
    if value is None and (table, name) == ("state", "file"):
        value = ""  # None says: keep none; leaving the key out would say: the usual one
    if name == "teeth_per_rev" and config.vehicle.teeth_by_wheel is not None:
        value = config.vehicle.teeth_by_wheel
    if isinstance(value, tuple) and (table == "tyre" or name == "measurements"):
        # None of the measurements is a choice; an empty curve is none at all.
        return json.dumps(list(value)) if value or table == "filter" else None
    return None if value is None or value == () or isinstance(value, dict) else _toml_value(value)


def signal_toml(can: CanConfig, role: str) -> str:
    """Return a signal's value as TOML: its name, or a table where it has options."""
    option, name = can.option(role), _toml_value(can.signals[role])
    parts = [f"signal = {name}"]
    for field in dataclasses.fields(option):
        value = getattr(option, field.name)
        if value is None or value == () or (field.name == "sign" and value == 1.0):
            continue
        if isinstance(value, Condition):
            text = _toml_value(f"{value.signal} {value.operator} {value.value:g}")
        else:
            text = repr(list(value)) if isinstance(value, tuple) else _toml_value(value)
        parts.append(f"{'sign' if field.name == 'backward_when' else field.name} = {text}")
    return name if len(parts) == 1 else "{ " + ", ".join(parts) + " }"


def _bus_table(bus: BusConfig, dbc: str) -> str:
    """Return a further bus as an inline table."""
    values = {"channel": bus.channel, "interface": bus.interface, "fd": bus.fd, "bitrate": bus.bitrate}
    parts = [f"{key} = {_toml_value(value)}" for key, value in values.items() if value is not None]
    return "{ " + ", ".join([*parts, f"dbc = {_toml_value(dbc)}"]) + " }"


def _quoted_key(name: str) -> str:
    """Return a TOML key in quotes."""
    return json.dumps(name, ensure_ascii=False)


def _toml_value(value: object) -> str:
    """Return a value as TOML text; TypeError for a type that no configuration has."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, tuple):
        return "{ " + ", ".join(f"{w} = {_toml_value(x)}" for w, x in zip(WHEELS, value, strict=True)) + " }"
    if isinstance(value, str | Path):
        return json.dumps(str(value), ensure_ascii=False)
    raise TypeError(f"{type(value).__name__} has no place in a configuration")
