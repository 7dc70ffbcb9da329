"""The schemas of the MCAP file, as JSON Schema, and its topics.

In: nothing. Out: `TOPICS`: topic -> JSON Schema of its messages. Titles that begin with `foxglove.` are
Foxglove's well-known schemas, which its panels (map, log) and PlotJuggler show without set-up.
"""

from __future__ import annotations

from typing import Any

from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.tables.columns import VEHICLE_STATE

Schema = dict[str, Any]


def _object(title: str, properties: dict[str, Schema]) -> Schema:
    return {"title": title, "type": "object", "properties": properties}


def _number(meaning: str) -> Schema:
    return {"type": "number", "description": meaning}


_TIME = _object("time", {"sec": {"type": "integer"}, "nsec": {"type": "integer"}})
WHEEL = _object(
    "tpmsd.Wheel",
    {
        "timestamp": _TIME,
        "deviation_mm": _number("radius minus nominal"),
        "lower_mm": _number("the same minus two standard deviations"),
        "upper_mm": _number("the same plus two standard deviations"),
        "change_mm": _number("radius minus the learned baseline; absent while it is learned"),
        "change_lower_mm": _number("the same minus two standard deviations"),
        "change_upper_mm": _number("the same plus two standard deviations"),
        "deflation_probability": _number("probability of a deflation"),
        "alarm": _number("1 while an alarm of this wheel is active"),
        "state": {"type": "string", "enum": ["unavailable", "learning", "monitoring", "alarm"]},
    },
)
MOTION = _object(
    "tpmsd.Motion",
    {
        "timestamp": _TIME,
        "speed_mps": _number("estimated speed"),
        "yaw_rate_radps": _number("estimated yaw rate"),
        "east_m": _number("estimated position in the plane of the first fix"),
        "north_m": _number("estimated position in the plane of the first fix"),
        "heading_rad": _number("estimated heading, counter-clockwise from east"),
        "gnss_age_s": _number("time since the last fix that was used"),
        "learning_fraction": _number("share of the baseline that is learned"),
        "faults": _number("faults of bus, receiver and clock in this tick"),
    },
)
INPUT = _object(
    "tpmsd.Input",
    {
        "timestamp": _TIME,
        **{f"rotation_{wheel}_radps": _number("rotation of the wheel") for wheel in WHEELS},
        "yaw_rate_radps": _number("yaw rate of the bus"),
        "accel_long_mps2": _number("longitudinal specific force"),
        "accel_lat_mps2": _number("lateral specific force"),
        "steering_wheel_angle_rad": _number("steering wheel angle"),
        "brake_pressure_pa": _number("brake pressure"),
        "drive_torque_nm": _number("drive torque"),
        "ambient_temp_k": _number("ambient temperature"),
    },
)
STATE = _object(
    "tpmsd.VehicleState",
    {"timestamp": _TIME, **{column.name: _number(column.meaning) for column in VEHICLE_STATE}},
)
LOCATION_FIX = _object(
    "foxglove.LocationFix",
    {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "latitude": _number("degrees"),
        "longitude": _number("degrees"),
        "altitude": _number("metres"),
        "position_covariance": {
            "type": "array",
            "items": {"type": "number"},
            "minItems": 9,
            "maxItems": 9,
            "description": "east, north, up in m2, row by row",
        },
        "position_covariance_type": {
            "title": "foxglove.PositionCovarianceType",
            "oneOf": [
                {"title": "UNKNOWN", "const": 0},
                {"title": "APPROXIMATED", "const": 1},
                {"title": "DIAGONAL_KNOWN", "const": 2},
                {"title": "KNOWN", "const": 3},
            ],
        },
    },
)
LOG = _object(
    "foxglove.Log",
    {
        "timestamp": _TIME,
        "level": {
            "title": "foxglove.LogLevel",
            "oneOf": [
                {"title": "UNKNOWN", "const": 0},
                {"title": "DEBUG", "const": 1},
                {"title": "INFO", "const": 2},
                {"title": "WARNING", "const": 3},
                {"title": "ERROR", "const": 4},
                {"title": "FATAL", "const": 5},
            ],
        },
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
)
GEO_JSON = _object("foxglove.GeoJSON", {"geojson": {"type": "string"}})

INFO, ERROR = 2, 4
DIAGONAL_KNOWN = 2
TOPICS: dict[str, Schema] = {
    **{f"/wheel/{wheel}": WHEEL for wheel in WHEELS},
    "/motion": MOTION,
    "/input": INPUT,
    "/gnss/fix": LOCATION_FIX,
    "/map": GEO_JSON,
    "/alarms": LOG,
}
STATE_TOPIC = "/vehicle_state"
"""Topic of a drive whose vehicle state is estimated."""
