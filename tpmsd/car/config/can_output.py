"""`[[can.output]]`: messages of a car's own that tpmsd is allowed to send.

In: values as `tomllib` gives them. Out: `OutputConfig` records, or `BadValueError`. Whether message and
signals exist is for `tpmsd.onboard.sinks.can_output` to say, which has the DBC.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tpmsd.car.config.model import OutputConfig, OutputSignal
from tpmsd.car.config.output_names import NAMES
from tpmsd.car.config.problems import BadValueError, is_file, show, show_key
from tpmsd.car.config.rules import Choice, FilePath, Number, Text, WholeNumber
from tpmsd.car.config.suggest import nearest

WHEN = ("cyclic", "change", "both")
J1939 = ("tire", "dm1")
ALGORITHM_NAMES = ("crc8_j1850", "crc8_autosar", "xor8", "sum8", "sum8_inverted", "toyota")
MAX_OUTPUTS, MAX_IDENTIFIERS, MAX_MAPPED, MAX_DATA_ID = 16, 32, 16, 8
LONGEST_ID = 0x1FFF_FFFF


@dataclass(frozen=True, slots=True)
class Identifiers:
    """The allow-list: identifiers that may be sent."""

    def read(self, value: object) -> tuple[int, ...]:
        """Return the identifiers; BadValueError if the value is no list of them."""
        if not isinstance(value, list) or len(value) > MAX_IDENTIFIERS:
            raise BadValueError("not a list", show(value), f"up to {MAX_IDENTIFIERS} identifiers, [0x3A0]")
        return tuple(WholeNumber(0, LONGEST_ID, base=16).read(one) for one in value)


def read_output(raw: object, folder: Path) -> OutputConfig:
    """Return the configuration of one entry; `BadValueError` names the key that is wrong."""
    if not isinstance(raw, dict):
        raise BadValueError("must be a table", show(raw), "[[can.output]] on a line of its own")
    rules: dict[str, Any] = {
        "message": Text(),
        "dbc": FilePath(folder),
        "bus": Text(),
        "when": Choice(WHEN),
        "period_s": Number(0.01, 60.0, "s"),
        "j1939": Choice(J1939),
        "source_address": WholeNumber(0, 253, base=16),
    }
    read: dict[str, Any] = {}
    for key, value in raw.items():
        if key == "signals":
            continue
        if key not in rules:
            known = (*rules, "signals")
            raise BadValueError(f"{show_key(key)}: unknown key", None, " ".join(known), nearest(key, known))
        read[key] = _read_key(key, rules[key].read, value)
    signals = raw.get("signals", {})
    if not isinstance(signals, dict):
        raise BadValueError("signals: must be a table", show(signals), "signal = 'value'")
    read["signals"] = tuple(
        (name, _read_key(f"signals.{show_key(name)}", _read_signal_fill, value))
        for name, value in signals.items()
    )
    _check_kind(read)
    dbc = read.get("dbc")
    if dbc is not None and not is_file(dbc):
        raise BadValueError("dbc: no such file", show(str(dbc)))
    return OutputConfig(**read)


def _check_kind(read: Mapping[str, Any]) -> None:
    """Raise BadValueError where an entry is neither a message with signals nor one of J1939."""
    if "j1939" in read:
        if "source_address" not in read:
            raise BadValueError("source_address: missing", None, "0x0 to 0xFD, one that nobody else uses")
        for key in ("message", "signals", "dbc"):
            if read.get(key):
                raise BadValueError(f"{key}: stands beside j1939", None, "one of the two")
    elif "message" not in read or not read["signals"]:
        raise BadValueError(f"{'signals' if 'message' in read else 'message'}: missing")
    elif "source_address" in read:
        raise BadValueError("source_address: only j1939 needs one")


def _read_signal_fill(value: object) -> OutputSignal:
    """Return value and options that fill a signal of a message; BadValueError if they are invalid."""
    if isinstance(value, bool):
        raise BadValueError("not a value", show(value), "a number, or a name in quotes")
    if isinstance(value, int | float):
        return OutputSignal(constant=Number(-1e18, 1e18).read(value))
    if isinstance(value, str):
        value = {"value": value}
    if not isinstance(value, dict) or "value" not in value:
        raise BadValueError("not a value", show(value), "a number, a name, or a table with value = 'name'")
    keys = ("value", "unknown", "map", "algorithm", "data_id", "modulo")
    for key in value:
        if key not in keys:
            raise BadValueError(f"{show_key(key)}: unknown key", None, " ".join(keys), nearest(key, keys))
    name = value["value"]
    if not isinstance(name, str) or name not in NAMES:
        near = nearest(name, NAMES) if isinstance(name, str) else None
        raise BadValueError("no such value", show(name), None if near else " ".join(NAMES), near)
    return _read_signal_options(name, value)


def _read_signal_options(name: str, value: Mapping[str, Any]) -> OutputSignal:
    """Return the table form of `_read_signal_fill`, of the value `name`."""
    for key, owner in (("algorithm", "checksum"), ("data_id", "checksum"), ("modulo", "counter")):
        if key in value and name != owner:
            raise BadValueError(f"{key}: is of a {owner} only")
    mapped = value.get("map", [])
    if not isinstance(mapped, list) or len(mapped) > MAX_MAPPED:
        raise BadValueError("map: not a list", show(mapped), "values for 0, 1, 2, ...: [0, 1, 1, 3]")
    data_id = value.get("data_id", [])
    if not isinstance(data_id, list) or len(data_id) > MAX_DATA_ID:
        raise BadValueError("data_id: not a list of bytes", show(data_id), "[0x12]")
    if name == "checksum" and "algorithm" not in value:
        raise BadValueError("algorithm: missing", None, " ".join(ALGORITHM_NAMES))
    return OutputSignal(
        value=name,
        unknown=_read_key("unknown", Number(-1e18, 1e18).read, value["unknown"])
        if "unknown" in value
        else None,
        mapped=tuple(_read_key("map", Number(-1e18, 1e18).read, one) for one in mapped),
        algorithm=_read_key("algorithm", Choice(ALGORITHM_NAMES).read, value["algorithm"])
        if "algorithm" in value
        else None,
        data_id=tuple(_read_key("data_id", WholeNumber(0, 255, base=16).read, one) for one in data_id),
        modulo=_read_key("modulo", WholeNumber(2, 1 << 32).read, value["modulo"])
        if "modulo" in value
        else None,
    )


def _read_key(key: str, read: Any, value: object) -> Any:
    """Return `read(value)`; its `BadValueError` names the key."""
    try:
        return read(value)
    except BadValueError as bad:
        raise BadValueError(f"{key}: {bad.what}", bad.found, bad.allowed, bad.suggestion) from None
