"""The tick table as MCAP, for Foxglove and PlotJuggler.

In: `TickTable`. Out: bytes of a file with JSON messages whose schemas are registered (`mcap_schemas`):
radii with bands per wheel, motion, inputs, fixes, the track as GeoJSON, alarms as log lines.
`docs/layouts` has a layout for each program. Numbers that nobody knows are left out of a message.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.tables.columns import INERTIAL, VEHICLE_STATE
from tpmsd.offline.tables.extras import import_extra
from tpmsd.offline.tables.mcap_schemas import DIAGONAL_KNOWN, ERROR, INFO, STATE, STATE_TOPIC, TOPICS
from tpmsd.offline.tables.tick_table import TickTable
from tpmsd.onboard.monitor.records import AlarmEvent

Message = tuple[float, str, dict[str, Any]]
MAX_TRACK_POINTS = 5_000
"""Points of the line on the map, at most; the fixes themselves are all in the file."""
_MOTION = ("speed_mps", "east_m", "north_m", "heading_rad", "gnss_age_s", "learning_fraction", "faults")
_INPUT = tuple(column.name for column in INERTIAL)


def mcap_bytes(table: TickTable) -> bytes:
    """Return the table as MCAP; ConfigError without the package mcap."""
    out = io.BytesIO()
    writer = import_extra("mcap.writer", "tables", "MCAP files").Writer(out)
    writer.start(profile="", library="tpmsd")
    channels, schemas = {}, {}
    states = {STATE_TOPIC: STATE} if _has_vehicle_state(table) else {}
    for topic, schema in {**TOPICS, **states}.items():
        name = schema["title"]
        if name not in schemas:
            data = json.dumps(schema).encode()
            schemas[name] = writer.register_schema(name=name, encoding="jsonschema", data=data)
        channels[topic] = writer.register_channel(
            topic=topic, message_encoding="json", schema_id=schemas[name]
        )
    for number, (time_s, topic, content) in enumerate(messages(table)):
        stamp = round(time_s * 1e9)
        message = content if topic == "/map" else {"timestamp": _ros_stamp(stamp), **content}
        writer.add_message(
            channel_id=channels[topic],
            log_time=stamp,
            publish_time=stamp,
            data=json.dumps(message, allow_nan=False).encode(),
            sequence=number,
        )
    writer.finish()
    return out.getvalue()


def messages(table: TickTable) -> Iterator[Message]:
    """Yield all messages as time, topic and content without its stamp; tick by tick, alarms after
    their tick.
    """
    if not len(table):
        return
    yield float(table["time_s"][0]), "/map", {"geojson": json.dumps(_track_geojson(table))}
    columns = {name: values.tolist() for name, values in table.numbers.items()}
    rotation = {wheel: _wheel_rates(table, wheel).tolist() for wheel in WHEELS}
    alarms = sorted(table.events, key=lambda alarm: alarm.time_s)
    said = 0
    for k, time_s in enumerate(columns["time_s"]):
        row = {name: values[k] for name, values in columns.items()}
        active = table.texts["alarms"][k].split()
        for wheel in WHEELS:
            yield (
                time_s,
                f"/wheel/{wheel}",
                _wheel_message(row, wheel, table.texts[f"state_{wheel}"][k], active),
            )
        motion = {name: row[name] for name in _MOTION}
        yield time_s, "/motion", _finite_values({**motion, "yaw_rate_radps": row["estimated_yaw_rate_radps"]})
        turns = {f"rotation_{wheel}_radps": rotation[wheel][k] for wheel in WHEELS}
        yield time_s, "/input", _finite_values({**turns, **{name: row[name] for name in _INPUT}})
        yield from _state_messages(row, time_s)
        if math.isfinite(row["gnss_latitude_deg"]):
            yield row["gnss_arrival_s"], "/gnss/fix", _location_fix_message(row)
        while said < len(alarms) and alarms[said].time_s <= time_s:
            yield alarms[said].time_s, "/alarms", _log_message(alarms[said])
            said += 1
    for alarm in alarms[said:]:
        yield alarm.time_s, "/alarms", _log_message(alarm)


def _state_messages(row: dict[str, float], time_s: float) -> Iterator[Message]:
    """Yield the message of the vehicle state; none where it is not known."""
    if math.isfinite(row.get(VEHICLE_STATE[0].name, math.nan)):
        yield time_s, STATE_TOPIC, {column.name: row[column.name] for column in VEHICLE_STATE}


def _has_vehicle_state(table: TickTable) -> bool:
    return VEHICLE_STATE[0].name in table.numbers


def _wheel_message(row: dict[str, float], wheel: str, state: str, active: list[str]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, prefix in (("deviation", ""), ("change", "change_")):
        middle, band = 1e3 * row[f"{name}_{wheel}_m"], 2e3 * row[f"{name}_std_{wheel}_m"]
        out |= {f"{name}_mm": middle, f"{prefix}lower_mm": middle - band, f"{prefix}upper_mm": middle + band}
    out["deflation_probability"] = row[f"deflation_probability_{wheel}"]
    out["alarm"] = float(any(alarm.endswith(f":{wheel}") for alarm in active))
    return {**_finite_values(out), "state": state}


def _location_fix_message(row: dict[str, float]) -> dict[str, Any]:
    variance = row["gnss_position_std_m"] ** 2
    known = math.isfinite(variance)
    # Heights of a receiver are half as good again.
    diagonal = (variance, variance, 2.25 * variance) if known else (0.0, 0.0, 0.0)
    covariance = [diagonal[k // 3] if k % 4 == 0 else 0.0 for k in range(9)]
    altitude = row["gnss_altitude_m"]
    return {
        "frame_id": "gnss",
        "latitude": row["gnss_latitude_deg"],
        "longitude": row["gnss_longitude_deg"],
        "altitude": altitude if math.isfinite(altitude) else 0.0,
        "position_covariance": covariance,
        "position_covariance_type": DIAGONAL_KNOWN if known else 0,
    }


def _log_message(alarm: AlarmEvent) -> dict[str, Any]:
    return {
        "level": ERROR if alarm.state == "raised" else INFO,
        "message": f"{alarm.kind} {alarm.wheel or ''} {alarm.state}: {alarm.reason}".replace("  ", " "),
        "name": str(alarm.kind),
        "file": "",
        "line": 0,
    }


def _track_geojson(table: TickTable) -> dict[str, Any]:
    """Return the fixes as one line, and the position of each alarm, as GeoJSON (RFC 7946)."""
    latitude, longitude, time_s = (
        table[name] for name in ("gnss_latitude_deg", "gnss_longitude_deg", "gnss_arrival_s")
    )
    known = np.flatnonzero(np.isfinite(latitude + longitude))
    shown = known[:: max(1, -(-len(known) // MAX_TRACK_POINTS))]
    points = np.column_stack([longitude[shown], latitude[shown]]).round(7).tolist()
    features: list[dict[str, Any]] = []
    if len(points) > 1:
        line = {"type": "LineString", "coordinates": points}
        features.append({"type": "Feature", "properties": {"name": "track"}, "geometry": line})
    for alarm in table.events:
        if not len(known):
            break
        at = known[min(int(np.searchsorted(time_s[known], alarm.time_s)), len(known) - 1)]
        point = {"type": "Point", "coordinates": [float(longitude[at]), float(latitude[at])]}
        name = f"{alarm.kind} {alarm.wheel or ''} {alarm.state}"
        features.append({"type": "Feature", "properties": {"name": name}, "geometry": point})
    return {"type": "FeatureCollection", "features": features}


def _wheel_rates(table: TickTable, wheel: str) -> FloatArray:
    """Return the (n,) rotation rate of a wheel, rad/s, by the differences of its angle; NaN at the
    first row.
    """
    angle, time_s = table[f"wheel_angle_{wheel}_rad"], table["drive_time_s"]
    return np.concatenate([[np.nan], np.diff(angle) / np.diff(time_s)])


def _finite_values(values: dict[str, float]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if math.isfinite(value)}


def _ros_stamp(nanoseconds: int) -> dict[str, int]:
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}
