"""The buses that the simulator can speak: which signals are where.

In: a kind and the number of wheels. Out: message layouts. `counts16`: four 16-bit counters in one message;
`counts8`: four 8-bit counters of half a count per bit, with a rolling counter; `split`: the axles in
different messages, with different periods and big endian; `speeds`: wheel speeds in 0.01 km/h.
"""

from __future__ import annotations

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.simulator.frame_layout import MessageLayout, SignalLayout

BUS_KINDS = ("counts16", "counts8", "split", "speeds")
ALIVE = "ALIVE"
"""Signal that counts a message's frames modulo its width."""


def bus_layout(kind: str, wheels: int = 4) -> tuple[MessageLayout, ...]:
    """Return the messages of a bus with four wheels, or with the rear pair alone; ConfigError on anything
    else."""
    if kind not in BUS_KINDS:
        raise ConfigError(f"unknown bus {kind!r} (buses: {' '.join(BUS_KINDS)})")
    if wheels not in (2, 4):
        raise ConfigError(f"{wheels} wheels: a bus carries 4, or 2 (the rear pair)")
    messages = {
        "counts16": _layout_counts16,
        "counts8": _layout_counts8,
        "split": _layout_split,
        "speeds": _layout_speeds,
    }[kind]()
    if wheels == 4:
        return messages
    front = tuple(f"{role}_{wheel}" for role in ("wheel_count", "wheel_speed") for wheel in ("fl", "fr"))
    kept = []
    for message in messages:
        signals = tuple(signal for signal in message.signals if signal.role not in front)
        if any(signal.role for signal in signals):
            kept.append(MessageLayout(message.frame_id, message.name, message.period_s, signals))
    return tuple(kept)


def _wheel_count_signal(
    wheel: str, start: int, bits: int, big_endian: bool = False, factor: float = 1.0
) -> SignalLayout:
    return SignalLayout(
        f"CNT_{wheel.upper()}", start, bits, big_endian, factor=factor, role=f"wheel_count_{wheel}"
    )


def _layout_counts16() -> tuple[MessageLayout, ...]:
    counters = tuple(_wheel_count_signal(wheel, 16 * k, 16) for k, wheel in enumerate(WHEELS))
    return (
        MessageLayout(0x0B0, "WHEELS", 0.02, counters),
        MessageLayout(
            0x0B4,
            "INERTIAL",
            0.02,
            (
                SignalLayout("YAW_RATE", 0, 16, signed=True, factor=0.005, unit="deg/s", role="yaw_rate"),
                SignalLayout("ACCEL_X", 16, 16, signed=True, factor=0.001, unit="m/s2", role="accel_long"),
                SignalLayout("ACCEL_Y", 32, 16, signed=True, factor=0.001, unit="m/s2", role="accel_lat"),
                SignalLayout(ALIVE, 56, 4),
            ),
        ),
        MessageLayout(0x0C4, "STEERING", 0.02, (_steering_signal(16),)),
        _powertrain_message(),
    )


def _layout_counts8() -> tuple[MessageLayout, ...]:
    counters = tuple(_wheel_count_signal(wheel, 8 * k, 8, factor=0.5) for k, wheel in enumerate(WHEELS))
    return (
        MessageLayout(0x387, "WHL_PUL", 0.01, (*counters, SignalLayout(ALIVE, 40, 4))),
        MessageLayout(
            0x220,
            "ESP",
            0.01,
            (
                SignalLayout("LAT_ACCEL", 0, 11, factor=0.002, offset=-2.048, unit="g", role="accel_lat"),
                SignalLayout("LONG_ACCEL", 13, 11, factor=0.002, offset=-2.048, unit="g", role="accel_long"),
                SignalLayout(
                    "YAW_RATE", 40, 15, factor=0.0002, offset=-3.2768, unit="rad/s", role="yaw_rate"
                ),
            ),
        ),
        MessageLayout(0x2B0, "SAS", 0.01, (_steering_signal(0),)),
        _powertrain_message(),
    )


def _layout_split() -> tuple[MessageLayout, ...]:
    return (
        MessageLayout(
            0x1A0,
            "FRONT_AXLE",
            0.04,
            (_wheel_count_signal("fl", 7, 16, True), _wheel_count_signal("fr", 23, 16, True)),
        ),
        MessageLayout(
            0x1A4,
            "REAR_AXLE",
            0.02,
            (
                _wheel_count_signal("rl", 3, 12, True),
                _wheel_count_signal("rr", 19, 12, True),
                SignalLayout(ALIVE, 63, 4, True),
            ),
        ),
        MessageLayout(
            0x1B0,
            "GYRO",
            0.02,
            (
                SignalLayout("YAW_RATE", 7, 16, True, True, factor=0.01, unit="deg/s", role="yaw_rate"),
                SignalLayout("ACCEL_Y", 23, 16, True, True, factor=0.001, unit="m/s2", role="accel_lat"),
                SignalLayout("ACCEL_X", 39, 16, True, True, factor=0.001, unit="m/s2", role="accel_long"),
            ),
        ),
        MessageLayout(
            0x1B4,
            "STEERING",
            0.02,
            (
                SignalLayout(
                    "STEER_ANGLE", 7, 16, True, True, factor=0.001, unit="rad", role="steering_wheel_angle"
                ),
            ),
        ),
    )


def _layout_speeds() -> tuple[MessageLayout, ...]:
    order = ("fr", "fl", "rr", "rl")
    speeds = tuple(
        SignalLayout(
            wheel.upper(), 7 + 16 * k, 16, True, factor=0.01, offset=-67.67, unit="km/h",
            role=f"wheel_speed_{wheel}",
        )
        for k, wheel in enumerate(order)
    )  # fmt: skip
    return (
        MessageLayout(0x0AA, "WHEEL_SPEEDS", 0.012, speeds),
        MessageLayout(
            0x024,
            "KINEMATICS",
            0.012,
            (
                SignalLayout(
                    "YAW_RATE", 1, 10, True, factor=0.244, offset=-125.0, unit="deg/s", role="yaw_rate"
                ),
                SignalLayout(
                    "ACCEL_Y", 33, 10, True, factor=0.03589, offset=-18.375, unit="m/s2", role="accel_lat"
                ),
            ),
        ),
        MessageLayout(
            0x025,
            "STEER_ANGLE_SENSOR",
            0.012,
            (
                SignalLayout(
                    "STEER_ANGLE", 3, 12, True, True, factor=1.5, unit="deg", role="steering_wheel_angle"
                ),
            ),
        ),
    )


def _steering_signal(start: int) -> SignalLayout:
    return SignalLayout(
        "STEER_ANGLE", start, 16, signed=True, factor=0.1, unit="deg", role="steering_wheel_angle"
    )


def _powertrain_message() -> MessageLayout:
    return MessageLayout(
        0x316,
        "POWERTRAIN",
        0.05,
        (
            SignalLayout("DRIVE_TORQUE", 0, 16, signed=True, factor=0.5, unit="Nm", role="drive_torque"),
            SignalLayout("BRAKE_PRESSURE", 16, 12, factor=0.1, unit="bar", role="brake_pressure"),
            SignalLayout("AMBIENT_TEMP", 32, 8, factor=0.5, offset=-40.0, unit="degC", role="ambient_temp"),
        ),
    )
