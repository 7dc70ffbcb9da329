"""Cars with drawn buses: wheel signals in any layout among decoys, names withheld.

In: a seed, a duration. Out: `DrawnBus`: frames, fixes, a DBC with meaningless names, and the truth. The
motion, the wheels and the receiver are those of `tpmsd.offline.simulator`; how the bus carries them is
drawn here: counters of 8 to 16 bits and speeds of several makers, moduli below the width, both byte orders,
one message or two, wheels in any order; and beside them ten decoys that follow the speed or count.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tpmsd.car.config.model import VehicleConfig
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.discovery.frames import BusLog
from tpmsd.offline.rings.tooth_count import tyre_radius_m
from tpmsd.offline.simulator.drive import DriveSpec, SimulatedDrive, simulate_drive
from tpmsd.offline.simulator.frame_layout import MessageLayout, SignalLayout, dbc_text
from tpmsd.offline.simulator.receiver import ReceiverSpec
from tpmsd.onboard.sources.can.block import block_of
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.events import GnssFix
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler


@dataclass(frozen=True)
class WheelLayout:
    """How a bus carries wheels."""

    name: str
    kind: str
    """counts | speeds"""
    bits: int
    big_endian: bool = False
    factor: float = 1.0
    offset: float = 0.0
    unit: str = ""
    modulus: int = 0
    per_message: int = 4
    period_s: float = 0.02


LAYOUTS = (
    WheelLayout("counts16", "counts", 16),
    WheelLayout("counts16-be-split", "counts", 16, True, per_message=2),
    WheelLayout("counts12-split", "counts", 12, True, per_message=2),
    WheelLayout("counts8-half", "counts", 8, factor=0.5, period_s=0.01),
    WheelLayout("counts10-1001", "counts", 10, modulus=1001, period_s=0.02),
    WheelLayout("counts8-254", "counts", 8, modulus=254, period_s=0.01),
    WheelLayout("speeds-0.01-be", "speeds", 16, True, 0.01, -67.67, "km/h", period_s=0.012),
    WheelLayout("speeds-0.0075", "speeds", 16, False, 0.0075, 0.0, "Unit_KiloMeterPerHour"),
    WheelLayout("speeds-1/32", "speeds", 14, False, 0.03125, 0.0, "km/h"),
    WheelLayout("speeds-15-be", "speeds", 15, True, 0.01, 0.0, "kph"),
    WheelLayout("speeds-mph", "speeds", 16, True, 0.01, 0.0, "mph"),
    WheelLayout("speeds-rad", "speeds", 16, True, 0.01, 0.0, "rad/s", per_message=2),
)
_FACTOR = {"km/h": 3.6, "kph": 3.6, "Unit_KiloMeterPerHour": 3.6, "mph": 1 / 0.44704}
TYRES = (
    "185/65R15",
    "195/65R15",
    "205/55R16",
    "205/60R15",
    "215/55R17",
    "225/45R17",
    "225/50R17",
    "235/60R18",
)
COPY_DELAY_S = 0.06
_OFF_CENTRE_RAD = 2e-3


@dataclass(frozen=True)
class DrawnBus:
    """A car with its bus and a drive."""

    seed: int
    layout: WheelLayout
    log: BusLog
    fixes: list[GnssFix]
    dbc: str
    truth: dict[str, str]
    """Wheel -> 'Message.Signal' of the DBC."""
    raw_truth: dict[str, tuple[int, int, bool]]
    """Wheel -> identifier, lowest bit (as byte * 8 + bit), byte order: the same without names."""
    drive: SimulatedDrive
    tyre: str
    """Size on the side wall."""
    uneven: bool
    """Whether the rings are off their centres (every second car); else they are perfect."""
    spec: DriveSpec = field(repr=False, default_factory=DriveSpec)


def draw(seed: int, duration_s: float = 900.0, layout: WheelLayout | None = None) -> DrawnBus:
    """One car; `layout` takes the place of a drawn one."""
    rng = np.random.default_rng([seed, 19])
    layout = layout or LAYOUTS[int(rng.integers(len(LAYOUTS)))]
    driven = str(rng.choice(["front", "rear"]))
    tyre = str(rng.choice(TYRES))
    radius = (tyre_radius_m(tyre) or 0.3) * (1 + 0.008 * float(rng.standard_normal()))
    uneven = seed % 2 == 0
    vehicle = VehicleConfig(
        wheel_radius_m=(radius,) * 4,
        track_front_m=(track := float(rng.uniform(1.44, 1.66))),
        track_rear_m=track + float(rng.uniform(-0.03, 0.03)),
        wheelbase_m=float(rng.uniform(2.45, 3.0)),
        driven_axle=driven,
        steering_ratio=float(rng.uniform(13, 18)),
        teeth_per_rev=float(rng.choice([43, 44, 47, 48, 48, 48, 50, 52])),
    )
    slip = make_effect(
        "longitudinal_slip", slip_per_accel=float(rng.uniform(0.003, 0.008)), slip_per_speed2=0.0
    )
    spec = DriveSpec(
        route="mixed",
        duration_s=duration_s,
        seed=seed,
        vehicle=vehicle,
        antenna_forward_m=float(rng.uniform(0.0, 2.0)),
        antenna_left_m=float(rng.uniform(-0.5, 0.5)),
        model=ExtendedModel((slip, *(_rings(seed) if uneven else ()))),
        receiver=ReceiverSpec(
            rate_hz=float(rng.choice([5.0, 10.0])), latency_s=float(rng.uniform(0.02, 0.25))
        ),
    )
    drive = simulate_drive(spec)
    messages, columns, truth, raw_truth = _bus(drive, layout, rng)
    log = BusLog()
    log.add(block_of(list(_frames(drive, messages, columns, rng))))
    return DrawnBus(
        seed,
        layout,
        log,
        gnss_fixes(drive),
        dbc_text(messages, with_periods=False),
        truth,
        raw_truth,
        drive,
        tyre,
        uneven,
        spec,
    )


def _rings(seed: int) -> list[Effect]:
    """Rings off their centre, each as far as the effect's prior has it (0.1 mm of 50 mm)."""
    rng = np.random.default_rng([seed, 48])
    return [
        make_effect(
            "tone_ring_error",
            wheel=wheel,
            amplitude_rad=_OFF_CENTRE_RAD * float(rng.standard_normal()),
            phase_rad=float(rng.uniform(-np.pi, np.pi)),
        )
        for wheel in WHEELS
    ]


def gnss_fixes(drive: SimulatedDrive) -> list[GnssFix]:
    """The fixes of a simulated drive, through the program's own reader."""
    assembler = NmeaAssembler()
    fixes: list[GnssFix] = []
    for line in drive.nmea:
        events = assembler.feed(line.time_s, line.text.encode("ascii"))
        fixes += [event for event in events if isinstance(event, GnssFix)]
    return fixes + [event for event in assembler.flush() if isinstance(event, GnssFix)]


def _bus(
    drive: SimulatedDrive, layout: WheelLayout, rng: np.random.Generator
) -> tuple[
    list[MessageLayout],
    dict[int, tuple[FloatArray, dict[str, FloatArray]]],
    dict[str, str],
    dict[str, tuple[int, int, bool]],
]:
    world = drive.world
    end = float(world.motion.time_s[-1])
    ids = [int(i) for i in rng.choice(np.arange(0x80, 0x700), 16, replace=False)]
    wheels = [str(w) for w in rng.permutation(np.array(WHEELS))]
    if layout.per_message == 2:
        wheels = sorted(wheels, key=lambda w: w[0])
    messages: list[MessageLayout] = []
    columns: dict[int, tuple[FloatArray, dict[str, FloatArray]]] = {}
    truth: dict[str, str] = {}
    raw_truth: dict[str, tuple[int, int, bool]] = {}
    number = 0

    def name() -> str:
        nonlocal number
        number += 1
        return f"S{number}"

    def stamps(period_s: float) -> FloatArray:
        return float(rng.uniform(0, period_s)) + period_s * np.arange(int(end / period_s) - 1)

    def wheel_message(part: list[str], delay_s: float, reported: bool) -> None:
        identifier = ids.pop()
        message = f"M{identifier}"
        t = stamps(layout.period_s)
        signals, raw = [], {}
        slot = 64 // layout.per_message if layout.per_message == 2 else 16
        slot = layout.bits if layout.bits in (10, 12, 14) and layout.per_message == 4 else min(slot, 16)
        slot = 8 if layout.bits == 8 else slot
        for place, wheel in enumerate(part):
            bit = place * slot
            start = 8 * (bit // 8) + 7 - bit % 8 if layout.big_endian else bit
            signal = SignalLayout(
                name(), start, layout.bits, layout.big_endian, factor=layout.factor, offset=layout.offset,
                unit=layout.unit,
            )  # fmt: skip
            signals.append(signal)
            raw[signal.name] = _wheel_raw(drive, layout, signal, wheel, t - delay_s, rng)
            if reported:
                truth[wheel] = f"{message}.{signal.name}"
                raw_truth[wheel] = identifier, signal.bit_positions()[0], layout.big_endian
        if layout.bits == 8:
            signals.append(SignalLayout(name(), 56, 4))
            raw[signals[-1].name] = np.arange(len(t)) % 16
        messages.append(MessageLayout(identifier, message, layout.period_s, tuple(signals)))
        columns[identifier] = t, raw

    parts = [wheels[:2], wheels[2:]] if layout.per_message == 2 else [wheels]
    for part in parts:
        wheel_message(part, 0.0, True)
    if rng.random() < 0.5:
        for part in parts:
            wheel_message(part, COPY_DELAY_S, False)
    _decoys(drive, messages, columns, ids, name, stamps, rng)
    return messages, columns, truth, raw_truth


def _wheel_raw(
    drive: SimulatedDrive,
    layout: WheelLayout,
    signal: SignalLayout,
    wheel: str,
    t: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    world, index = drive.world, WHEELS.index(wheel)
    t = np.maximum(t, 0.0)
    if layout.kind == "counts":
        modulus = layout.modulus or 1 << layout.bits
        return (
            np.floor(world.counts_at(t, index) / layout.factor).astype(np.int64) + int(rng.integers(1 << 20))
        ) % modulus
    teeth = world.car.teeth_per_rev
    turned = (
        (world.counts_at(t, index) - world.counts_at(np.maximum(t - 0.02, 0.0), index)) * 2 * np.pi / teeth
    )
    omega = turned / 0.02
    if layout.unit == "rad/s":
        return signal.raw_of(omega)
    maker_radius = float(world.car.radius_m[index]) * 1.01
    return signal.raw_of(omega * maker_radius * _FACTOR[layout.unit])


def _decoys(drive, messages, columns, ids, name, stamps, rng) -> None:  # type: ignore[no-untyped-def]
    motion = drive.world.motion
    speed = motion.speed_mps
    tau = 0.3
    lag = np.exp(-0.01 / tau)
    filtered = np.empty_like(speed)
    value = 0.0
    for k, v in enumerate(speed):
        value = lag * value + (1 - lag) * v
        filtered[k] = value
    gear = np.digitize(speed, [4, 8, 13, 19, 25])
    ratio = np.array([110.0, 65.0, 45.0, 34.0, 28.0, 23.0])[gear]

    def at(values, t):  # type: ignore[no-untyped-def]
        return np.interp(t, motion.time_s, values)

    def message(period_s, *signals):  # type: ignore[no-untyped-def]
        identifier = ids.pop()
        t = stamps(period_s)
        layouts, raw = [], {}
        for layout, values in signals:
            layouts.append(layout)
            raw[layout.name] = values(t, layout)
        messages.append(MessageLayout(identifier, f"M{identifier}", period_s, tuple(layouts)))
        columns[identifier] = t, raw

    kmh: dict[str, Any] = {"factor": 0.01, "unit": "km/h"}
    noise = lambda n, s: s * rng.standard_normal(n)  # noqa: E731
    message(
        0.01,
        (
            SignalLayout(name(), 7, 16, True, factor=0.25, unit="rpm"),
            lambda t, s: s.raw_of(np.maximum(at(ratio * speed, t), 750) + noise(len(t), 8)),
        ),
        (SignalLayout(name(), 23, 16, True, factor=0.1), lambda t, s: s.raw_of(at(speed / ratio * 1e3, t))),
    )
    message(
        0.02,
        (SignalLayout(name(), 0, 16, **kmh), lambda t, s: s.raw_of(3.6 * at(filtered, t))),
        (
            SignalLayout(name(), 16, 16, **kmh),
            lambda t, s: s.raw_of(3.6 * at(speed, t) + noise(len(t), 0.02)),
        ),
        (SignalLayout(name(), 56, 8), lambda t, s: rng.integers(0, 256, len(t))),
    )
    message(
        0.1,
        (SignalLayout(name(), 0, 24), lambda t, s: (at(motion.distance_m, t) / 0.1).astype(np.int64) + 12345),
        (
            SignalLayout(name(), 32, 16, **kmh),
            lambda t, s: s.raw_of(3.6 * at(speed, t - 0.35) + noise(len(t), 0.15)),
        ),
    )
    message(
        0.02,
        (
            SignalLayout(name(), 7, 16, True, True, 0.01, unit="deg/s"),
            lambda t, s: s.raw_of(np.degrees(at(motion.yaw_rate_radps, t)) + 0.2 + noise(len(t), 0.1)),
        ),
        (
            SignalLayout(name(), 23, 16, True, True, 0.01, unit="m/s2"),
            lambda t, s: s.raw_of(at(motion.accel_lat_mps2, t) + noise(len(t), 0.04)),
        ),
        (SignalLayout(name(), 60, 4, True), lambda t, s: np.arange(len(t)) % 16),
    )
    message(
        0.01,
        (SignalLayout(name(), 0, 16), lambda t, s: (t * 1000).astype(np.int64) % 65536),
        (SignalLayout(name(), 24, 8), lambda t, s: rng.integers(0, 256, len(t))),
    )


def _frames(drive: SimulatedDrive, messages, columns, rng):  # type: ignore[no-untyped-def]
    clock = drive.spec.clocks
    times, ids, rows = [], [], []
    for layout in messages:
        t, raw = columns[layout.frame_id]
        times.append(np.maximum.accumulate(t + rng.exponential(0.0004, len(t))))
        ids.append(np.full(len(t), layout.frame_id))
        rows.append(layout.pack({k: np.asarray(v, dtype=np.int64) for k, v in raw.items()}, len(t)))
    time_s, identifier, data = np.concatenate(times), np.concatenate(ids), np.concatenate(rows)
    order = np.argsort(time_s, kind="stable")
    host = clock.host_s(time_s[order]).tolist()
    payload = np.ascontiguousarray(data[order]).tobytes()
    for k, (t, i) in enumerate(zip(host, identifier[order].tolist(), strict=True)):
        yield CanFrame(t, "can0", i, False, False, False, False, payload[8 * k : 8 * k + 8])
