"""The `vehicle.toml` of a drive that was made from tables.

In: the tables [vehicle], [gnss] and others as plain values, the encoded signals. Out: TOML text, and `Config`
with every problem reported as of a file. Pure.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tpmsd.car.config.document import Document
from tpmsd.car.config.load import DBC_FILE, parse
from tpmsd.car.config.locate import locate
from tpmsd.car.config.model import Config
from tpmsd.car.config.problems import ConfigProblems
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.tables.encode import CHANNEL, Encoded

Table = Mapping[str, Any]


def car_tables(encoded: Encoded, given: Table) -> dict[str, Any]:
    """Return all tables of the configuration: the given ones, and the places of the encoded signals."""
    vehicle = dict(given.get("vehicle", {}))
    if encoded.counts_per_rev is not None:
        vehicle["teeth_per_rev"] = encoded.counts_per_rev
    tables = {name: dict(table) for name, table in given.items() if name not in ("vehicle", "can")}
    can = {"channel": CHANNEL, "dbc": DBC_FILE, "signals": dict(encoded.signals)}
    return {"vehicle": vehicle, "can": can, **tables}


def toml_text(tables: Table) -> str:
    """Return plain values as TOML; ConfigError for a value that TOML cannot hold."""
    lines: list[str] = []
    for name, table in tables.items():
        plain = {key: value for key, value in table.items() if key != "signals"}
        lines += [f"[{name}]", *(f"{key} = {_toml_value(value)}" for key, value in plain.items()), ""]
        if "signals" in table:
            lines.append(f"[{name}.signals]")
            lines += [f"{key} = {_toml_value(value)}" for key, value in table["signals"].items()] + [""]
    return "\n".join(lines)


def config_of(text: str, file: Path = Path("vehicle.toml")) -> Config:
    """Return the configuration in a text, without reading a DBC; ConfigProblems with everything that is
    wrong.
    """
    parsed = parse(Document(file, tomllib.loads(text), locate(text)), dbc_elsewhere=True)
    if parsed.config is None:
        raise ConfigProblems(parsed.problems)
    return parsed.config


def _toml_value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml_value(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(one) for one in value) + "]"
    if hasattr(value, "item"):  # a number of numpy
        return _toml_value(value.item())
    raise ConfigError(f"not a value of a configuration: {value!r}")
