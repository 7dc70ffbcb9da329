"""A configuration as TOML, so that a recording holds what the daemon really ran with.

In: `Config`, command-line options worked in. Out: text that `tpmsd.config.load` reads back to the same
values.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from tpmsd.config.model import Config
from tpmsd.wheels import WHEELS

_TABLES = ("vehicle", "can", "gnss", "filter", "monitor", "tyre", "alarms", "status", "state", "calibration")


def config_toml(config: Config, dbc: str) -> str:
    """All tables with all values; `dbc` is the name under which the DBC lies beside the file."""
    lines: list[str] = []
    for table in _TABLES:
        record = getattr(config, table)
        lines.append(f"[{table}]")
        for field in dataclasses.fields(record):
            value = getattr(record, field.name)
            if field.name == "dbc":
                value = dbc
            if value is None and (table, field.name) == ("state", "file"):
                value = ""  # None says: keep none; leaving the key out would say: the usual one
            if value is not None and value != () and not isinstance(value, dict):
                text = repr(list(value)) if table == "tyre" and isinstance(value, tuple) else _toml(value)
                lines.append(f"{field.name} = {text}")
        lines.append("")
        if table == "can":
            lines.append("[can.signals]")
            lines += [f"{role} = {_toml(signal)}" for role, signal in config.can.signals.items()]
            lines.append("")
    return "\n".join(lines)


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, tuple):
        return "{ " + ", ".join(f"{w} = {_toml(x)}" for w, x in zip(WHEELS, value, strict=True)) + " }"
    if isinstance(value, str | Path):
        return json.dumps(str(value), ensure_ascii=False)
    raise TypeError(f"{type(value).__name__} has no place in a configuration")
