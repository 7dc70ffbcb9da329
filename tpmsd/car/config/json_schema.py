"""The JSON Schema of `vehicle.toml`, made from the rules that read it, so that editors complete and check
the file.

In: nothing. Out: a document of JSON Schema draft 2020-12. It holds what can be said of each value alone;
what keys must agree on with each other is for `tpmsd check`.
"""

from __future__ import annotations

from functools import singledispatch
from pathlib import Path
from typing import Any

from tpmsd.car.config import model
from tpmsd.car.config.can_output import (
    ALGORITHM_NAMES,
    J1939,
    LONGEST_ID,
    MAX_IDENTIFIERS,
    WHEN,
    Identifiers,
)
from tpmsd.car.config.dynamics import RADIUS
from tpmsd.car.config.gnss_source import ALLOWED, DeviceRule, SourceRule
from tpmsd.car.config.rules import (
    TYRE_SIZE,
    ChannelName,
    Choice,
    FilePath,
    Flag,
    IncreasingNumbers,
    Number,
    Text,
    TyreSize,
    WholeNumber,
    Words,
)
from tpmsd.car.config.schema import tables
from tpmsd.car.config.signal_table import SignalEntry, TeethTable
from tpmsd.foundation.wheels import WHEELS

SCHEMA_ID = "tpmsd.vehicle/1"
Schema = dict[str, Any]
_SIGNAL: Schema = {"type": "string", "pattern": r"^\s*[^\s.]+\.[^\s.]+\s*$", "description": "Message.Signal"}
_TEXT: Schema = {"type": "string", "pattern": r"\S"}


@singledispatch
def of_rule(rule: object) -> Schema:
    """Return the schema of one rule; TypeError for a rule without one."""
    raise TypeError(f"no schema for the rule {type(rule).__name__}")


@of_rule.register
def _(rule: Number) -> Schema:
    low, high = ("exclusiveMinimum", "exclusiveMaximum") if rule.open else ("minimum", "maximum")
    unit = {"description": rule.unit} if rule.unit else {}
    return {"type": "number", low: rule.low, high: rule.high, **unit}


@of_rule.register
def _(rule: WholeNumber) -> Schema:
    return {"type": "integer", "minimum": rule.low, "maximum": rule.high}


@of_rule.register
def _(rule: Flag) -> Schema:
    return {"type": "boolean"}


@of_rule.register
def _(rule: Choice) -> Schema:
    return {"enum": list(rule.words)}


@of_rule.register
def _(rule: Text) -> Schema:
    return dict(_TEXT)


@of_rule.register
def _(rule: DeviceRule) -> Schema:
    return {**_TEXT, "not": {"pattern": "://"}, "description": "a serial line"}


@of_rule.register
def _(rule: SourceRule) -> Schema:
    return {**_TEXT, "description": ALLOWED}


@of_rule.register
def _(rule: FilePath) -> Schema:
    return (
        {"type": "string", "description": "a path"}
        if rule.may_be_empty
        else {**_TEXT, "description": "a path"}
    )


@of_rule.register
def _(rule: ChannelName) -> Schema:
    return {"anyOf": [dict(_TEXT), {"type": "integer", "minimum": 0, "maximum": 255}]}


@of_rule.register
def _(rule: TyreSize) -> Schema:
    return {"type": "string", "pattern": "(?i)" + TYRE_SIZE.pattern, "description": "205/60R15"}


@of_rule.register
def _(rule: IncreasingNumbers) -> Schema:
    return {"type": "array", "items": of_rule(rule.each), "minItems": 2, "maxItems": 50}


@of_rule.register
def _(rule: Words) -> Schema:
    items: Schema = {"enum": list(rule.choices)} if rule.choices else {"type": "string"}
    return {"type": "array", "items": items, "maxItems": rule.most}


@of_rule.register
def _(rule: Identifiers) -> Schema:
    return {"type": "array", "items": of_rule(WholeNumber(0, LONGEST_ID)), "maxItems": MAX_IDENTIFIERS}


@of_rule.register
def _(rule: TeethTable) -> Schema:
    return {"anyOf": [of_rule(rule.each), _table_schema({wheel: of_rule(rule.each) for wheel in WHEELS})]}


@of_rule.register
def _(rule: SignalEntry) -> Schema:
    comparison: Schema = {**_TEXT, "description": "Message.Signal == number"}
    keys: dict[str, Schema] = {
        "signal": _SIGNAL,
        "invalid": {"type": "array", "items": {"type": "integer"}, "maxItems": 64},
        "valid_when": comparison,
        "sign": {"anyOf": [{"enum": [1, -1]}, {**_TEXT, "description": "Message.Signal, or a comparison"}]},
        "scale": {"type": "number", "not": {"const": 0}},
        "bus": dict(_TEXT),
    }
    if rule.role.startswith("wheel_count_"):
        keys["modulus"] = {"type": "integer", "minimum": 2}
    else:
        keys |= {"offset": {"type": "number"}, "unit": dict(_TEXT)}
    return {"anyOf": [_SIGNAL, _table_schema(keys, ["signal"])]}


def _table_schema(properties: dict[str, Schema], required: list[str] | None = None) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
        **({"required": required} if required else {}),
    }


def _bus_schema(can: dict[str, Schema]) -> Schema:
    keys = {key: can[key] for key in ("channel", "interface", "dbc", "fd", "bitrate")}
    return {"anyOf": [can["channel"], _table_schema(keys, ["channel"])]}


def _output_schema(can: dict[str, Schema]) -> Schema:
    value = {
        "value": {"type": "string"},
        "map": {"type": "array", "items": {"type": "number"}},
        "unknown": {"type": "number"},
        "modulo": {"type": "integer", "minimum": 2},
        "algorithm": {"enum": list(ALGORITHM_NAMES)},
        "data_id": {"type": "array", "items": {"type": "integer", "minimum": 0, "maximum": 255}},
    }
    signal = {"anyOf": [{"type": "string"}, {"type": "number"}, {"type": "object", "properties": value}]}
    keys = {
        "message": dict(_TEXT),
        "dbc": can["dbc"],
        "bus": dict(_TEXT),
        "when": {"enum": list(WHEN)},
        "period_s": of_rule(Number(0.01, 60.0, "s")),
        "j1939": {"enum": list(J1939)},
        "source_address": of_rule(WholeNumber(0, 253)),
        "signals": {"type": "object", "additionalProperties": signal},
    }
    return {"type": "array", "items": _table_schema(keys), "maxItems": 16}


def vehicle_schema() -> Schema:
    """Return the schema of the whole file."""
    properties = {
        table: {key: of_rule(rule) for key, rule in rules.items()} for table, rules in tables(Path()).items()
    }
    signals = _table_schema(properties.pop("can.signals"))
    wheels = _table_schema({wheel: of_rule(RADIUS) for wheel in WHEELS})
    properties["vehicle"]["wheel_radius_m"] = {"anyOf": [of_rule(RADIUS), wheels]}
    can = properties["can"]
    can |= {
        "signals": signals,
        "buses": {"type": "object", "additionalProperties": _bus_schema(can), "maxProperties": 8},
        "output": _output_schema(can),
    }
    for table, record in (("filter", model.FilterConfig()), ("monitor", model.MonitorConfig())):
        for key, schema in properties[table].items():
            default = getattr(record, key, None)
            if isinstance(default, bool | int | float | str):
                schema["default"] = default
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:{SCHEMA_ID.replace('/', ':')}",
        "title": "vehicle.toml of tpmsd",
        "type": "object",
        "properties": {name: _table_schema(keys) for name, keys in properties.items()},
        "required": ["vehicle", "can"],
        "additionalProperties": False,
    }
