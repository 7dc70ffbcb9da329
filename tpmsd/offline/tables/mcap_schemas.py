"""The schemas of the MCAP file, as JSON Schema, and its topics.

In: nothing. Out: `TOPICS`: topic -> JSON Schema of its messages. Titles that begin with `foxglove.` are
Foxglove's well-known schemas, which its panels (map, log) and PlotJuggler show without set-up.
"""

from __future__ import annotations

from typing import Any

from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.tables.columns import VEHICLE_STATE

Schema = dict[str, Any]


def _object_schema(title: str, properties: dict[str, Schema]) -> Schema:
    return {"title": title, "type": "object", "properties": properties}


def _number_schema(meaning: str) -> Schema:
    return {"type": "number", "description": meaning}


_TIME = _object_schema("time", {"sec": {"type": "integer"}, "nsec": {"type": "integer"}})
WHEEL = _object_schema(
    "tpmsd.Wheel",
    {
        "timestamp": _TIME,
        "deviation_mm": _number_schema("radius minus nominal"),
        "lower_mm": _number_schema("the same minus two standard deviations"),
        "upper_mm": _number_schema("the same plus two standard deviations"),
        "change_mm": _number_schema("radius minus the learned baseline; absent while it is learned"),
        "change_lower_mm": _number_schema("the same minus two standard deviations"),
        "change_upper_mm": _number_schema("the same plus two standard deviations"),
        "deflation_probability": _number_schema("probability of a deflation"),
        "alarm": _number_schema("1 while an alarm of this wheel is active"),
        "state": {"type": "string", "enum": ["unavailable", "learning", "monitoring", "alarm"]},
    },
)
MOTION = _object_schema(
    "tpmsd.Motion",
    {
        "timestamp": _TIME,
        "speed_mps": _number_schema("estimated speed"),
        "yaw_rate_radps": _number_schema("estimated yaw rate"),
        "east_m": _number_schema("estimated position in the plane of the first fix"),
        "north_m": _number_schema("estimated position in the plane of the first fix"),
        "heading_rad": _number_schema("estimated heading, counter-clockwise from east"),
        "gnss_age_s": _number_schema("time since the last fix that was used"),
        "learning_fraction": _number_schema("share of the baseline that is learned"),
        "faults": _number_schema("faults of bus, receiver and clock in this tick"),
    },
)
INPUT = _object_schema(
    "tpmsd.Input",
    {
        "timestamp": _TIME,
        **{f"rotation_{wheel}_radps": _number_schema("rotation of the wheel") for wheel in WHEELS},
        "yaw_rate_radps": _number_schema("yaw rate of the bus"),
        "accel_long_mps2": _number_schema("longitudinal specific force"),
        "accel_lat_mps2": _number_schema("lateral specific force"),
        "steering_wheel_angle_rad": _number_schema("steering wheel angle"),
        "brake_pressure_pa": _number_schema("brake pressure"),
        "drive_torque_nm": _number_schema("drive torque"),
        "ambient_temp_k": _number_schema("ambient temperature"),
    },
)
STATE = _object_schema(
    "tpmsd.VehicleState",
    {"timestamp": _TIME, **{column.name: _number_schema(column.meaning) for column in VEHICLE_STATE}},
)
LOCATION_FIX = _object_schema(
    "foxglove.LocationFix",
    {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "latitude": _number_schema("degrees"),
        "longitude": _number_schema("degrees"),
        "altitude": _number_schema("metres"),
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
LOG = _object_schema(
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
GEO_JSON = _object_schema("foxglove.GeoJSON", {"geojson": {"type": "string"}})

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
