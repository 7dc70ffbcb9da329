"""The buses: what cantools decodes is what the wheels did, for every kind."""

from __future__ import annotations

import re
from dataclasses import replace

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.offline.simulator.drives import straight, world_of
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.simulator.bus import BusSpec, FrameLog, frames_of
from tpmsd.offline.simulator.bus_layouts import ALIVE, BUS_KINDS, bus_layout
from tpmsd.offline.simulator.clock import Clocks
from tpmsd.offline.simulator.frame_layout import MessageLayout, SignalLayout, dbc_text
from tpmsd.offline.simulator.world import World

CLOCKS = Clocks(start_utc_s=1000.0)
TEETH_PER_RAD = 48 / (2 * np.pi)


def log_of(world: World, seed: int = 1, **options: object) -> FrameLog:
    """The frames of this bus; sampled and stamped at the same instant unless told otherwise."""
    spec = BusSpec(**{"jitter_s": 0.0, **options})
    return frames_of(world, spec, CLOCKS, np.random.default_rng(seed))


def decoded(log: FrameLog, kind: str, role: str, wheels: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """(time since the start, value) of a role's signal, decoded by cantools from the DBC text."""
    layout = bus_layout(kind, wheels)
    database = cantools.database.load_string(dbc_text(layout), "dbc")
    message, signal = next((m, s) for m in layout for s in m.signals if s.role == role)
    mine = log.frame_id == message.frame_id
    definition = database.get_message_by_frame_id(message.frame_id)
    values = [definition.decode(row.tobytes())[signal.name] for row in log.data[mine]]
    return log.time_s[mine] - CLOCKS.start_utc_s, np.array(values, dtype=float)


def width(kind: str, role: str) -> tuple[int, float]:
    """(bits, factor) of a role's signal."""
    signal = next(s for m in bus_layout(kind) for s in m.signals if s.role == role)
    return signal.bits, signal.factor


@pytest.mark.parametrize("wheel", range(4))
@pytest.mark.parametrize("kind", ["counts16", "counts8", "split"])
def test_counts_are_the_edges_up_to_the_frame(kind: str, wheel: int) -> None:
    """Each count is floor(angle * teeth / 2 pi) at the frame's instant, modulo its width, plus a start."""
    world = world_of(straight(25.0, 20.0))
    role = f"wheel_count_{WHEELS[wheel]}"
    time, count = decoded(log_of(world, kind=kind), kind, role)
    bits, factor = width(kind, role)
    # Times of log lines are rounded by double precision near 1e3 s, which moves no edge by more than one.
    edges = np.floor(world.angle_at(time, wheel) * TEETH_PER_RAD / factor)
    difference = (count / factor - edges) % (1 << bits)
    start = np.median(difference)

    assert np.mean(difference == start) > 0.999
    assert np.abs(difference - start).max() <= 1
    assert count.max() < (1 << bits) * factor


def test_counts_are_exact_where_time_is() -> None:
    """With the drive starting at time zero every single count is exact."""
    world = world_of(straight(25.0, 60.0))
    log = frames_of(world, BusSpec(jitter_s=0.0), Clocks(start_utc_s=0.0), np.random.default_rng(1))
    wheels = log.frame_id == 0x0B0
    raw = log.data[wheels].view("<u2")
    for wheel in range(4):
        edges = np.floor(world.angle_at(log.time_s[wheels], wheel) * TEETH_PER_RAD).astype(int)
        assert {(int(raw[0, wheel]) - int(edges[0])) % 65536} == set((raw[:, wheel] - edges) % 65536)


@pytest.mark.parametrize("wheel", range(4))
def test_speeds_are_the_turn_since_the_last_frame(wheel: int) -> None:
    """A wheel of 1 % less radius reads 1 % more speed, to half the resolution of 0.01 km/h."""
    effect = make_effect("radius_change", wheel="rl", deviation_m=-0.00316)
    world = world_of(straight(20.0, 30.0), ExtendedModel((effect,)))
    _, speed = decoded(log_of(world, kind="speeds"), "speeds", f"wheel_speed_{WHEELS[wheel]}")
    expected = 72.0 / 0.99 if wheel == 2 else 72.0

    assert pytest.approx(expected, abs=0.0051) == np.median(speed[5:])


@pytest.mark.parametrize(
    ("role", "expected", "tolerance"),
    [
        ("yaw_rate", 0.1, 0.002),
        ("accel_lat", 2.0, 0.03),
        ("accel_long", 0.0, 0.03),
        ("steering_wheel_angle", 15.0 * np.arctan(2.63 / 200.0), 0.005),
    ],
)
@pytest.mark.parametrize("kind", BUS_KINDS)
def test_inertial_signals_have_their_unit_and_sign(
    kind: str, role: str, expected: float, tolerance: float
) -> None:
    """A left turn of 0.1 rad/s at 20 m/s reads so on every bus, in whatever unit its DBC states."""
    layout = bus_layout(kind)
    signal = next((s for m in layout for s in m.signals if s.role == role), None)
    if signal is None:
        assert ("speeds", "accel_long") == (kind, role)
        return
    _, values = decoded(log_of(world_of(straight(20.0, 60.0, yaw=0.1)), kind=kind), kind, role)
    si = {"deg/s": np.pi / 180, "deg": np.pi / 180, "g": 9.80665}.get(signal.unit, 1.0)
    resolution = signal.factor * si

    assert pytest.approx(expected, abs=tolerance / 10 + resolution) == np.mean(values) * si
    assert pytest.approx(np.hypot(tolerance, resolution / 12**0.5), rel=0.35, abs=resolution) == (
        np.std(values) * si
    )


def test_accelerometers_report_specific_force() -> None:
    """At constant speed up a slope of 0.1 rad accel_long reads g*sin(0.1)."""
    motion = straight(20.0, 30.0)
    motion.grade_rad[:] = 0.1
    _, values = decoded(log_of(world_of(motion)), "counts16", "accel_long")

    assert pytest.approx(9.80665 * np.sin(0.1), abs=0.005) == values.mean()


def test_gyro_effects_reach_the_bus() -> None:
    """A bias of 0.01 rad/s reads as 0.573 deg/s on a straight."""
    model = ExtendedModel((make_effect("yaw_rate_bias", bias=0.01),))
    _, values = decoded(log_of(world_of(straight(20.0, 60.0), model)), "counts16", "yaw_rate")

    assert pytest.approx(np.degrees(0.01), abs=0.02) == values.mean()


@pytest.mark.parametrize("kind", BUS_KINDS)
def test_frames_come_at_their_period(kind: str) -> None:
    """Each message has as many frames as its period fits into the drive, evenly spaced, in order of time."""
    log = log_of(world_of(straight(20.0, 10.0)), kind=kind)

    assert np.diff(log.time_s).min() >= 0.0
    for message in bus_layout(kind):
        times = log.time_s[log.frame_id == message.frame_id]
        assert abs(len(times) - 10.0 / message.period_s) <= 1
        assert pytest.approx(message.period_s, abs=1e-6) == np.diff(times).max()


def test_lost_and_repeated_frames_come_at_their_rate() -> None:
    """5 % lost and 3 % sent twice, the repetition with the same payload just after."""
    world = world_of(straight(20.0, 200.0))
    whole, faulty = log_of(world), log_of(world, lost_fraction=0.05, repeated_fraction=0.03)
    gyro = faulty.data[faulty.frame_id == 0x0B4]
    alive = (gyro[:, 7] & 15).astype(int)
    steps = np.diff(alive) % 16

    assert pytest.approx(0.95 * 1.03, abs=0.01) == len(faulty) / len(whole)
    assert pytest.approx(0.03, abs=0.006) == np.mean(steps == 0)
    assert pytest.approx(0.05, abs=0.008) == np.sum(steps[steps > 1] - 1) / 10_000
    assert gyro[1:][steps == 0].tolist() == gyro[:-1][steps == 0].tolist()


def test_jitter_delays_and_never_hastens() -> None:
    """The host's stamp is later than the sampling instant by the mean given; order within a message holds."""
    world = world_of(straight(20.0, 100.0))
    exact, late = log_of(world), log_of(world, jitter_s=0.001)
    delay = late.time_s[late.frame_id == 0x0B0] - exact.time_s[exact.frame_id == 0x0B0]

    assert delay.min() >= 0.0
    assert pytest.approx(0.001, rel=0.1) == delay.mean()


def test_a_reset_counter_starts_again_from_zero() -> None:
    """At 5 s the counters are zero, and count on from there."""
    world = world_of(straight(20.0, 10.0))
    time, count = decoded(log_of(world, resets_s=(5.0,)), "counts16", "wheel_count_rl")
    after = count[time >= 5.0]

    assert 0.0 == after[0]
    assert pytest.approx(5.0 * 20 / 0.316 * TEETH_PER_RAD, abs=12) == after[-1]


@pytest.mark.parametrize("kind", BUS_KINDS)
def test_with_two_wheels_the_front_is_not_on_the_bus(kind: str) -> None:
    """The DBC of a two-wheel bus has the rear pair's signals and none of the front's."""
    roles = {s.role for m in bus_layout(kind, 2) for s in m.signals}
    wheel_roles = {role for role in roles if role.startswith("wheel_")}
    stem = "wheel_speed" if kind == "speeds" else "wheel_count"

    assert {f"{stem}_rl", f"{stem}_rr"} == wheel_roles
    assert "yaw_rate" in roles


def test_buses_that_cannot_be() -> None:
    """Unknown kinds and three wheels are one line."""
    with pytest.raises(
        ConfigError, match=r"^unknown bus 'flexray' \(buses: counts16 counts8 split speeds\)$"
    ):
        bus_layout("flexray")
    with pytest.raises(ConfigError, match=r"^3 wheels: a bus carries 4, or 2"):
        bus_layout("counts16", 3)


@pytest.mark.parametrize("wheels", [2, 4])
@pytest.mark.parametrize("kind", BUS_KINDS)
def test_packing_agrees_with_cantools(kind: str, wheels: int) -> None:
    """Random raw values packed by columns are byte for byte what cantools encodes from the DBC text."""
    rng = np.random.default_rng(1)
    layout = bus_layout(kind, wheels)
    database = cantools.database.load_string(dbc_text(layout), "dbc")
    for message in layout:
        raw = {}
        for signal in message.signals:
            low, high = signal.limits()
            raw[signal.name] = rng.integers(low, high, 30, endpoint=True)
        packed = message.pack(raw, 30)
        for k in range(30):
            values = {name: int(column[k]) for name, column in raw.items()}
            encoded = database.encode_message(message.frame_id, values, scaling=False, strict=False)
            assert encoded == packed[k].tobytes()


@settings(derandomize=True, deadline=None, max_examples=150)
@given(
    st.integers(1, 32).flatmap(lambda bits: st.tuples(st.just(bits), st.integers(0, 64 - bits))),
    st.booleans(),
    st.booleans(),
    st.data(),
)
def test_any_signal_is_packed_as_cantools_packs_it(
    place: tuple[int, int], big_endian: bool, signed: bool, data: st.DataObject
) -> None:
    """Any place, width, byte order and sign: the packed bytes are what cantools encodes."""
    bits, first = place
    # The first-th bit in order of significance from the message's top, in DBC numbering.
    start = 8 * (first // 8) + 7 - first % 8 if big_endian else first
    signal = SignalLayout("S", start, bits, big_endian, signed)
    value = data.draw(st.integers(*signal.limits()))
    message = MessageLayout(0x123, "M", 0.01, (signal,))
    database = cantools.database.load_string(dbc_text((message,)), "dbc")
    expected = database.encode_message(0x123, {"S": value}, scaling=False, strict=False)

    assert expected == message.pack({"S": np.array([value])}, 1)[0].tobytes()


def test_values_beyond_the_signal_are_held_at_its_limits() -> None:
    """A sensor clips, it does not wrap around."""
    signal = SignalLayout("S", 0, 8, signed=True, factor=0.5)

    assert [-128, 127, 2] == signal.raw_of(np.array([-1000.0, 1000.0, 1.0])).tolist()


def test_periods_are_in_the_dbc_unless_left_out() -> None:
    """cantools reads the cycle times in milliseconds; a DBC without them is read as well."""
    layout = bus_layout("split")
    stated = cantools.database.load_string(dbc_text(layout), "dbc")
    silent = cantools.database.load_string(dbc_text(layout, with_periods=False), "dbc")

    assert [40, 20, 20, 20] == [m.cycle_time for m in stated.messages]
    assert [None] * 4 == [m.cycle_time for m in silent.messages]
    assert ALIVE in [s.name for s in stated.get_message_by_name("REAR_AXLE").signals]


@pytest.mark.parametrize(("kind", "bits"), [("counts16", 16), ("counts8", 8), ("split", 12)])
def test_counters_that_turn_over_from_frame_to_frame_are_refused(kind: str, bits: int) -> None:
    """A million counts per revolution fit no bus; the number that the error names fits, and 5 % more does
    not."""
    plain = world_of(straight(30.0, 5.0))

    def with_teeth(teeth: float) -> World:
        return replace(plain, car=replace(plain.car, teeth_per_rev=teeth))

    with pytest.raises(
        ConfigError, match=f"teeth_per_rev = 1e\\+06: the {bits} bits of CNT_.. turn over"
    ) as caught:
        log_of(with_teeth(1e6), kind=kind)
    most = float(re.findall(r"up to (\d+) counts", str(caught.value))[0])
    log_of(with_teeth(0.99 * most), kind=kind)
    with pytest.raises(ConfigError, match="turn over"):
        log_of(with_teeth(1.05 * most), kind=kind)
