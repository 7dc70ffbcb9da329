"""Rules of the values that may be tables: a signal with options, a further bus, teeth by wheel.

In: a value as `tomllib` gives it. Out: records of `tpmsd.car.config.model`, or `BadValueError`, which names
the key within the table.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from tpmsd.car.config.model import BusConfig, Condition, SignalOptions
from tpmsd.car.config.problems import BadValueError, is_file, show, show_key
from tpmsd.car.config.rules import ChannelName, FilePath, Flag, Number, SignalName, Text, WholeNumber
from tpmsd.car.config.suggest import nearest
from tpmsd.car.config.units import canonical_unit
from tpmsd.foundation.wheels import WHEELS

_NAME = "'Message.Signal' as in the DBC"
_CONDITION = re.compile(r"(\S+?)\s*(==|!=|<=|>=|<|>)\s*([-+0-9.xXa-fA-F]+)\Z")
_CONDITION_ALLOWED = "'Message.Signal == number' (or != < <= > >=)"
_MAX_INVALID = 64
_MAX_BUSES = 8
_WIDEST = (1 << 64) - 1


class _KeyRule(Protocol):
    def read(self, value: object) -> object: ...


@dataclass(frozen=True, slots=True)
class WhenSignal:
    """A comparison, such as 'MSG.QF == 1'; a signal alone stands for '!= 0'."""

    bare: bool = False
    """True if a signal alone, without options, will do."""

    def read(self, value: object) -> Condition:
        """Return the comparison; BadValueError if the value is none."""
        text = Text().read(value)
        match = _CONDITION.match(text)
        if match is None:
            if self.bare:
                return Condition(SignalName().read(text), "!=", 0.0)
            raise BadValueError("not a comparison", show(text), _CONDITION_ALLOWED)
        try:
            number = float(int(match[3], 0)) if match[3].lower().startswith("0x") else float(match[3])
        except ValueError:
            raise BadValueError("not a number", show(match[3]), _CONDITION_ALLOWED) from None
        return Condition(SignalName().read(match[1]), match[2], number)


@dataclass(frozen=True, slots=True)
class _RawValues:
    def read(self, value: object) -> tuple[int, ...]:
        allowed = f"a list of up to {_MAX_INVALID} raw values"
        if not isinstance(value, list) or len(value) > _MAX_INVALID:
            raise BadValueError("not a list", show(value), allowed)
        return tuple(WholeNumber(-(1 << 63), _WIDEST).read(one) for one in value)


@dataclass(frozen=True, slots=True)
class _Sign:
    def read(self, value: object) -> float | Condition:
        allowed = "1, -1, or the 'Message.Signal' that is not 0 (or a comparison) while turning backward"
        if isinstance(value, str):
            return WhenSignal(bare=True).read(value)
        if isinstance(value, bool) or value not in (1, -1):
            raise BadValueError("not a sign", show(value), allowed)
        assert isinstance(value, int | float)
        return float(value)


@dataclass(frozen=True, slots=True)
class _Factor:
    def read(self, value: object) -> float:
        factor = Number(-1e12, 1e12).read(value)
        if factor == 0.0:
            raise BadValueError("a signal of scale 0 is constant", show(value))
        return factor


@dataclass(frozen=True, slots=True)
class _Unit:
    def read(self, value: object) -> str:
        text = Text().read(value)
        if canonical_unit(text) is None:
            raise BadValueError("an unknown unit", show(text), "a unit such as 'km/h', 'rad/s', 'deg', 'bar'")
        return text


@dataclass(frozen=True, slots=True)
class SignalEntry:
    """A signal: its name, or a table with the name and what the DBC does not say."""

    role: str

    def read(self, value: object) -> tuple[str, SignalOptions]:
        """Return the signal's name and its options; BadValueError if the value states none."""
        if not isinstance(value, dict):
            return SignalName().read(value), SignalOptions()
        keys: dict[str, _KeyRule] = {
            "signal": SignalName(),
            "invalid": _RawValues(),
            "valid_when": WhenSignal(),
            "sign": _Sign(),
            "scale": _Factor(),
            "offset": Number(-1e12, 1e12),
            "unit": _Unit(),
            "bus": Text(),
        }
        if self.role.startswith("wheel_count_"):
            keys["modulus"] = WholeNumber(2, 1 << 63)
            del keys["unit"], keys["offset"]
        read = _read_keys(value, keys)
        if "signal" not in read:
            raise BadValueError("signal: missing", allowed=_NAME)
        name = read.pop("signal")
        sign = read.pop("sign", 1.0)
        if isinstance(sign, Condition):
            return name, SignalOptions(**read, backward_when=sign)
        return name, SignalOptions(**read, sign=sign)


@dataclass(frozen=True, slots=True)
class BusEntry:
    """A further bus: a table, or its channel alone."""

    folder: Path

    def read(self, value: object, main: Mapping[str, Any], main_dbc: Path | None) -> BusConfig:
        """Return the bus; keys that it lacks are those of [can] (`main`, `main_dbc`)."""
        rules: dict[str, _KeyRule] = {
            "channel": ChannelName(),
            "interface": Text(),
            "dbc": FilePath(self.folder),
            "fd": Flag(),
            "bitrate": WholeNumber(5_000, 8_000_000),
        }
        if not isinstance(value, dict):
            value = {"channel": value}
        read = _read_keys(value, rules)
        if "channel" not in read:
            raise BadValueError("channel: missing", allowed="the channel's name, such as 'can1'")
        dbc = read.pop("dbc", main_dbc)
        if dbc is None or not is_file(dbc):
            raise BadValueError("dbc: no such file", show(str(dbc)))
        inherited = {key: main[key] for key in ("interface", "fd", "bitrate") if key in main}
        return BusConfig(**{**inherited, **read, "dbc": dbc})


@dataclass(frozen=True, slots=True)
class TeethTable:
    """Counts per revolution: one number, or a table of wheels."""

    each: Number

    def read(self, value: object) -> float | dict[str, float]:
        """Return the number of teeth of all wheels, or of each by its name; BadValueError else."""
        if not isinstance(value, dict):
            return self.each.read(value)
        for wheel in value:
            if wheel not in WHEELS:
                raise BadValueError(
                    f"no such wheel {show_key(wheel)}", None, " ".join(WHEELS), nearest(wheel, WHEELS)
                )
        if not value:
            raise BadValueError("an empty table", None, "fl fr rl rr")
        return {wheel: _read_at_key(wheel, self.each, number) for wheel, number in value.items()}


def _read_keys(value: Mapping[str, object], rules: Mapping[str, _KeyRule]) -> dict[str, Any]:
    read = {}
    for key, one in value.items():
        if key not in rules:
            raise BadValueError(f"{show_key(key)}: unknown key", None, " ".join(rules), nearest(key, rules))
        read[key] = _read_at_key(key, rules[key], one)
    return read


def _read_at_key(key: str, rule: Any, value: object) -> Any:
    """Return `rule.read(value)`; its `BadValueError` names the key."""
    try:
        return rule.read(value)
    except BadValueError as bad:
        raise BadValueError(f"{key}: {bad.what}", bad.found, bad.allowed, bad.suggestion) from None


def buses_of(
    raw: object, folder: Path, main: Mapping[str, Any], main_dbc: Path | None
) -> tuple[dict[str, BusConfig], dict[str, BadValueError]]:
    """Return the valid buses of [can.buses], and the error of each other one by name ('': the whole
    table)."""
    if not isinstance(raw, dict):
        return {}, {"": BadValueError("must be a table", show(raw), "can1 = { channel = 'can1' }")}
    if len(raw) > _MAX_BUSES:
        return {}, {"": BadValueError("too many buses", str(len(raw)), f"at most {_MAX_BUSES}")}
    good, bad = {}, {}
    for name, value in raw.items():
        try:
            good[name] = BusEntry(folder).read(value, main, main_dbc)
        except BadValueError as error:
            bad[name] = error
    return good, bad
