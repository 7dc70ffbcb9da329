"""Files of the result: `vehicle.toml`, and a DBC for fields found in raw frames.

In: `BusDiscovery`. Out: text.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

from tpmsd.offline.discovery.raw_fields import dbc_start
from tpmsd.offline.discovery.result import BusDiscovery, FoundRole
from tpmsd.offline.discovery.series import MessageField
from tpmsd.offline.discovery.settings import SETTINGS
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT, EXTENDED

_LENGTHS = (8, 12, 16, 20, 24, 32, 48, 64)
"""Bytes of a frame, the longer ones of CAN FD."""
_USUAL = {
    "track_front_m": SETTINGS.track_m,
    "track_rear_m": SETTINGS.track_m,
    "wheelbase_m": SETTINGS.wheelbase_m,
}


def vehicle_text(found: BusDiscovery, dbc: str) -> str:
    """Return a configuration that `tpmsd check` accepts; what is undecided stands in comments."""
    source = f"tpmsd init, {found.car}" if found.assignment is None else "tpmsd discover"
    lines = [f"# By {source}. Look over what is marked as undecided."]
    lines += [f"# undecided: {one.key}: {one.why}. It takes: {one.drive}." for one in found.undecided]
    lines += [f"# contradicted: {said}." for said in found.contradictions]
    lines += [*_vehicle_table(found), *_can_tables(found, dbc), *_gnss_table(found)]
    return "\n".join(lines) + "\n"


def _vehicle_table(found: BusDiscovery) -> list[str]:
    """Return the table [vehicle], with what was not measured marked."""
    lines = ["", "[vehicle]"]
    radius = found.geometry.get("wheel_radius_m")
    lines.append(f"wheel_radius_m = {radius.value if radius else SETTINGS.radius_m:.4f}")
    for key, usual in _USUAL.items():
        measured = found.geometry.get(key)
        if measured is None and key == "track_front_m":
            measured = found.geometry.get("track_rear_m")
        note = "" if measured is not None else "   # a usual value: not measured"
        lines.append(f"{key} = {measured.value if measured else usual:.3f}{note}")
    axle = found.driven_axle
    if axle is not None and axle[1] >= SETTINGS.decided:
        lines.append(f'driven_axle = "{axle[0]}"   # probability {axle[1]:.2f}')
    elif axle is not None:
        lines.append('# driven_axle = "front"   # or "rear", "all": this drive does not tell')
    if found.counts_per_rev is not None:
        probability, spread = found.counts_probability, found.counts_per_rev.std
        by_radius = f"+- {spread:.0f}, by the rolling radius alone" if spread > 0.0 else "a usual value"
        note = f"probability {probability:.2f}" if probability > 0.0 else f"{by_radius}: not measured"
        lines.append(f"teeth_per_rev = {found.counts_per_rev.value:g}   # {note}")
    return lines


def _can_tables(found: BusDiscovery, dbc: str) -> list[str]:
    """Return the lines of `[can]`, `[can.buses.*]` and `[can.signals]` of a `vehicle.toml`."""
    main = found.main_bus
    lines = ["", "[can]", 'interface = "socketcan"']
    lines += [f"channel = {json.dumps(found.channel(main))}", f"dbc = {json.dumps(dbc)}"]
    for bus in further_buses(found):
        name = json.dumps(found.channel(bus))
        lines += ["", f"[can.buses.{name}]", f"channel = {name}"]
        lines += [f"dbc = {json.dumps(dbc if found.has_dbc else dbc_name_of_bus(dbc, found.channel(bus)))}"]
    lines += ["", "[can.signals]"]
    for role, one in found.roles.items():
        bus_name = "" if one.bus == main else found.channel(one.bus)
        lines.append(f"{role} = {_signal_entry(one, bus_name)}   # {one.probability:.3f}")
    return lines


def _gnss_table(found: BusDiscovery) -> list[str]:
    """Return the table [gnss]: antenna and latency where they are well known."""
    lines = ["", "[gnss]", 'device = "/dev/ttyACM0"', "baud = 115200"]
    for key, low, high in (("antenna_forward_m", -10.0, 20.0), ("antenna_left_m", -3.0, 3.0)):
        antenna = found.gnss.get(key)
        use = antenna is not None and antenna.std < 0.5 and low <= antenna.value <= high
        lines.append(f"{key} = {antenna.value:.2f}" if use and antenna is not None else f"{key} = 0.0")
    latency = found.gnss.get("latency_s")
    if latency is not None and latency.std < 0.05 and 0.0 <= latency.value <= 5.0:
        lines.append(f"latency_s = {latency.value:.3f}")
    return lines


def further_buses(found: BusDiscovery) -> list[int]:
    """Return the numbers of the buses other than the main one that carry a signal."""
    return sorted({one.bus for one in found.roles.values()} - {found.main_bus})


def dbc_name_of_bus(dbc: str, channel: str) -> str:
    """Return the name of the DBC of a further bus, beside that of the main one: `bus.can1.dbc`."""
    return f"{dbc.removesuffix('.dbc')}.{channel}.dbc"


def _signal_entry(one: FoundRole, bus: str = "") -> str:
    """Return the value of a role in `[can.signals]`; `bus`: name of the further bus that carries it."""
    name = json.dumps(one.field.signal)
    as_named = one.is_plain or _is_described_by_dbc(one)
    if as_named and not bus:
        return name
    parts = [f"signal = {name}"] + ([f"bus = {json.dumps(bus)}"] if bus else [])
    if as_named:
        return "{ " + ", ".join(parts) + " }"
    if one.modulus:
        parts.append(f"modulus = {one.modulus}")
    if one.invalid:
        parts.append(f"invalid = [{', '.join(str(number) for number in one.invalid)}]")
    if one.scale is not None:
        parts.append(f"scale = {one.scale:.10g}")
    if one.offset is not None:
        parts.append(f"offset = {one.offset:.10g}")
    if one.unit is not None:
        parts.append(f"unit = {json.dumps(one.unit)}")
    if one.sign < 0:
        parts.append("sign = -1")
    return "{ " + ", ".join(parts) + " }"


def _is_described_by_dbc(one: FoundRole) -> bool:
    """Return whether the field was found in raw frames and our own DBC describes it completely."""
    return one.field.message.startswith("ID_") and not one.modulus and not one.invalid


def dbc_text(found: BusDiscovery, bus: int | None = None) -> str:
    """Return a DBC of the fields of a bus that have a role; messages are called by their identifiers.

    `bus`: by default the main one.
    """
    by_key: dict[int, list[FoundRole]] = {}
    for one in found.roles.values():
        if one.bus == (found.main_bus if bus is None else bus):
            by_key.setdefault(one.field.key & (1 << BUS_SHIFT) - 1, []).append(one)
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: CAR", ""]
    for key, roles in sorted(by_key.items()):
        number = (key & ~EXTENDED) | (1 << 31 if key & EXTENDED else 0)
        lines.append(f"BO_ {number} {roles[0].field.message}: {_message_length(roles)} CAR")
        lines += [_dbc_signal_line(one) for one in roles]
        lines.append("")
    return "\n".join(lines)


def _message_length(roles: Sequence[FoundRole]) -> int:
    """Return the smallest CAN payload length, bytes, that holds the fields of all roles."""
    return next(size for size in _LENGTHS if size >= max(one.field.layout.min_bytes for one in roles))


def _dbc_signal_line(one: FoundRole) -> str:
    """Return the SG_ line of a DBC file for a signal that was found."""
    field: MessageField = one.field
    bits = field.layout
    scale = one.scale if one.scale is not None else field.scale
    offset = one.offset if one.offset is not None else field.offset
    position = f"{dbc_start(field)}|{bits.length}@{0 if bits.big_endian else 1}{'-' if bits.signed else '+'}"
    low, high = offset, scale * bits.mask + offset
    unit = one.unit or field.unit
    return (
        f' SG_ {field.name} : {position} ({scale:.10g},{offset:.10g}) [{low:.10g}|{high:.10g}] "{unit}" CAR'
    )
