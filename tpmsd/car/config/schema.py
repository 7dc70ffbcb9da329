"""Every table and key that a configuration may have, and the rule of its value.

In: the folder of the configuration, for its relative paths. Out: `{table: {key: rule}}`. A new key is a row
here and a field with its default in `tpmsd.car.config.model`; what keys must agree with each other is in
`tpmsd.car.config.agree`.
"""

from __future__ import annotations

from pathlib import Path

from tpmsd.car.config import dynamics
from tpmsd.car.config.can_output import Identifiers
from tpmsd.car.config.gnss_source import DeviceRule, SourceRule
from tpmsd.car.config.model import (
    FILTER_GATES,
    FILTER_METHODS,
    FIX_WEIGHTS,
    MEASUREMENTS,
    ROLES,
    VEHICLE_STATE_METHODS,
)
from tpmsd.car.config.rules import (
    ChannelName,
    Choice,
    FilePath,
    Flag,
    IncreasingNumbers,
    Number,
    Rule,
    Text,
    TyreSize,
    WholeNumber,
    Words,
)
from tpmsd.car.config.signal_table import SignalEntry, TeethTable
from tpmsd.foundation.wheels import WHEELS

DRIVEN_AXLES = ("front", "rear", "all")
_TRACK = Number(0.8, 3.0, "m")
_PROBABILITY = Number(0.0, 1.0, "share", open=True)
_PERCENT = Number(0.01, 20.0, "%")
_DURATION = Number(0.0, 86_400.0, "s")
_LONGEST_CAN_ID = 0x1FFF_FFFF


def tables(folder: Path) -> dict[str, dict[str, Rule]]:
    """Return table -> key -> rule; [can.signals] is 'can.signals', and `agree` reads `wheel_radius_m`."""
    return {
        "vehicle": {
            "name": Text(),
            "wheel_radius_m": dynamics.RADIUS,
            "track_front_m": _TRACK,
            "track_rear_m": _TRACK,
            "wheelbase_m": Number(1.0, 8.0, "m"),
            "driven_axle": Choice(DRIVEN_AXLES),
            "steering_ratio": Number(1.0, 60.0),
            "teeth_per_rev": TeethTable(Number(0.0, 1e8, open=True)),  # an encoder has tens of thousands
        },
        "can": {
            "interface": Text(),
            "channel": ChannelName(),
            "dbc": FilePath(folder),
            "fd": Flag(),
            "bitrate": WholeNumber(5_000, 8_000_000),
            "output_ids": Identifiers(),
        },
        "can.signals": {role: SignalEntry(role) for role in ROLES},
        "gnss": {
            "device": DeviceRule(),
            "source": SourceRule(),
            "baud": WholeNumber(300, 4_000_000),
            "antenna_forward_m": Number(-10.0, 20.0, "m"),
            "antenna_left_m": Number(-3.0, 3.0, "m"),
            "latency_s": Number(0.0, 5.0, "s"),
            "host_clock": Choice(("free", "utc")),
        },
        "obd": {
            "speed": Flag(),
            "period_s": Number(0.2, 60.0, "s"),
            "bus": Text(),
            "extended_ids": Flag(),
        },
        "filter": {
            "method": Choice(FILTER_METHODS),
            "rate_hz": Number(1.0, 100.0, "Hz"),
            "particles": WholeNumber(10, 1_000_000),
            "window_s": Number(2.0, 86_400.0, "s"),
            "seed": WholeNumber(0, 2**63 - 1),
            "min_speed_mps": Number(0.0, 30.0, "m/s"),
            "max_accel_long_mps2": Number(0.1, 20.0, "m/s2"),
            "max_accel_lat_mps2": Number(0.1, 20.0, "m/s2"),
            "gate": Choice(FILTER_GATES),
            "max_wheel_slip": Number(0.0005, 0.2, "share"),
            "max_side_slip_rad": Number(0.002, 0.5, "rad"),
            "fix_weights": Choice(FIX_WEIGHTS),
            "measurements": Words(len(MEASUREMENTS), MEASUREMENTS),
            "model": FilePath(folder),
        },
        "monitor": {
            "learn_s": Number(1.0, 86_400.0, "s"),
            "deflation_percent": _PERCENT,
            "deflation_pressure_percent": Number(5.0, 50.0, "%"),
            "deviation_percent": _PERCENT,
            "raise_probability": _PROBABILITY,
            "clear_probability": _PROBABILITY,
            "raise_hold_s": _DURATION,
            "clear_hold_s": _DURATION,
            "malfunction_s": Number(1.0, 86_400.0, "s"),
            "gnss_malfunction_s": Number(1.0, 86_400.0, "s"),
            "resonance": Flag(),
        },
        "tyre": {
            "size": TyreSize(),
            "load_n": Number(500.0, 60_000.0, "N"),
            "pressure_kpa": Number(80.0, 1200.0, "kPa"),
            "stiffness_npm": Number(2e4, 5e6, "N/m"),
            "curve_pressure_percent": IncreasingNumbers(Number(0.0, 100.0, "%", open=True)),
            "curve_radius_mm": IncreasingNumbers(Number(0.0, 100.0, "mm", open=True)),
        },
        "alarms": {
            "can": Flag(),
            "channel": ChannelName(),
            "status_id": WholeNumber(0, _LONGEST_CAN_ID, base=16),
            "alarm_id": WholeNumber(0, _LONGEST_CAN_ID, base=16),
            "reset_id": WholeNumber(0, _LONGEST_CAN_ID, base=16),
            "extended_ids": Flag(),
            "status_period_s": Number(0.01, 60.0, "s"),
            "alarm_period_s": Number(0.01, 60.0, "s"),
        },
        "status": {
            "socket": FilePath(folder, socket=True),
            "mode": WholeNumber(0, 0o777, base=8),
        },
        "notify": {
            "command": Words(64),
            "kinds": Words(8, ("deflation", "radius_deviation", "slow_leak", "malfunction")),
            "min_interval_s": Number(0.0, 86_400.0, "s"),
            "timeout_s": Number(0.1, 3600.0, "s"),
        },
        "state": {
            "file": FilePath(folder, may_be_empty=True),
            "interval_s": Number(1.0, 86_400.0, "s"),
        },
        "dynamics": dict(dynamics.RULES),
        "vehicle_state": {
            "method": Choice(VEHICLE_STATE_METHODS),
            "particles": WholeNumber(10, 10_000),
        },
        "calibration": {
            "made": Text(),
            "method": Text(),
            "drives": Text(),
            "reference_speed_mps": Number(0.0, 100.0, "m/s"),
            **{f"radius_std_{wheel}_m": Number(0.0, 0.1, "m") for wheel in WHEELS},
            "track_rear_std_m": Number(0.0, 1.0, "m"),
            "track_front_std_m": Number(0.0, 1.0, "m"),
            **{f"bus_radius_{wheel}_m": dynamics.RADIUS for wheel in WHEELS},
        },
        "physics": {
            "effects_path": FilePath(folder),
        },
    }
