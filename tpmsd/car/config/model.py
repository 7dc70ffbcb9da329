"""The configuration as typed records, with the defaults in one place.

In: nothing. Out: `Config` and its tables. `tpmsd.car.config.load` fills them from TOML and says what is
wrong. Units are SI; keys carry them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from tpmsd.car.config.dynamics_record import DynamicsConfig
from tpmsd.foundation.plain import brief

WHEEL_COUNT_ROLES = ("wheel_count_fl", "wheel_count_fr", "wheel_count_rl", "wheel_count_rr")
WHEEL_SPEED_ROLES = ("wheel_speed_fl", "wheel_speed_fr", "wheel_speed_rl", "wheel_speed_rr")
OPTIONAL_ROLES = (
    "yaw_rate",
    "accel_long",
    "accel_lat",
    "steering_wheel_angle",
    "brake_pressure",
    "drive_torque",
    "ambient_temp",
)
FLAG_ROLES = ("abs_active", "esc_active", "brake_active", "reverse_gear", "tyre_set")
"""States of the car that the bus states; plain numbers, no unit."""
GNSS_ROLES = (
    "gnss_latitude",
    "gnss_longitude",
    "gnss_altitude",
    "gnss_speed",
    "gnss_course",
    "gnss_utc",
    "gnss_fix",
)
"""A receiver whose fixes come on CAN."""
FILTER_METHODS = (
    *("aug-ekf", "aug-pf", "aug-ukf", "gaussian-sum"),
    *("mpf-mn", "mpf-pn", "mpf-pn-niw", "mpf-pn-paper", "mpf-rb"),
)
DEFAULT_METHOD = "gaussian-sum"
FILTER_GATES = ("thresholds", "slip")
FIX_WEIGHTS = ("square", "igg3")
VEHICLE_STATE_METHODS = ("ekf", "ukf", "upf", "arupf")
"""Filters of the vehicle state (`tpmsd.car.vehicle_state.estimator`)."""
MEASUREMENTS = ("position", "speed", "course", "yaw_rate", "steering")
"""Measurements that a filter may use beside the rotation of the wheels."""
ROLES = WHEEL_COUNT_ROLES + WHEEL_SPEED_ROLES + OPTIONAL_ROLES + FLAG_ROLES + GNSS_ROLES


@dataclass(frozen=True, slots=True)
class VehicleConfig:
    """Vehicle data known to the operator."""

    wheel_radius_m: tuple[float, float, float, float]
    """Nominal effective rolling radius of fl, fr, rl, rr."""
    track_rear_m: float
    track_front_m: float
    wheelbase_m: float
    driven_axle: str = "front"
    """front | rear | all"""
    steering_ratio: float | None = None
    """Steering-wheel angle over road-wheel angle; None if unknown."""
    teeth_per_rev: float = 48.0
    """Counts per wheel revolution; of the first wheel that has a number where they differ."""
    teeth_by_wheel: tuple[float, float, float, float] | None = None
    """Counts per revolution of fl, fr, rl, rr where they differ."""
    name: str | None = field(default=None, compare=False)
    """The car's name for its readers; nothing is computed from it."""

    def teeth(self, wheel: int) -> float:
        """Return counts per revolution of one wheel, by its index in `tpmsd.foundation.wheels.WHEELS`."""
        return self.teeth_per_rev if self.teeth_by_wheel is None else self.teeth_by_wheel[wheel]


@dataclass(frozen=True, slots=True)
class Condition:
    """A comparison of a signal with a number, such as `MSG.QF == 1`."""

    signal: str
    """'Message.Signal'."""
    operator: str
    """One of == != < <= > >=."""
    value: float
    """Physical value, as the DBC scales it."""


@dataclass(frozen=True, slots=True)
class SignalOptions:
    """Options of the table form of a signal beyond its name; None or empty: as the DBC has it."""

    modulus: int | None = None
    """A counter rolls over from modulus - 1 to 0."""
    invalid: tuple[int, ...] = ()
    """Raw values that mean 'no value', beside those of the DBC."""
    valid_when: Condition | None = None
    """The value counts only while this holds."""
    sign: float = 1.0
    """-1: the signal has the opposite sign."""
    backward_when: Condition | None = None
    """The wheel turns backward while this holds (`sign = "MSG.DIR"`), and the signal has no sign."""
    scale: float | None = None
    offset: float | None = None
    unit: str | None = None
    bus: str | None = None
    """A name of [can.buses]; None: the bus of [can]."""


@dataclass(frozen=True, slots=True)
class BusConfig:
    """A further bus."""

    channel: str
    dbc: Path
    interface: str = "socketcan"
    fd: bool = False
    bitrate: int | None = None


@dataclass(frozen=True, slots=True)
class OutputSignal:
    """Value and options that fill a signal of `[[can.output]]`."""

    value: str | None = None
    """A name of `tpmsd.onboard.sinks.output_values.NAMES`; None: the constant."""
    constant: float = 0.0
    unknown: float | None = None
    """Physical value where nobody knows the number; None: the signal's initial value."""
    mapped: tuple[float, ...] = ()
    """Physical values for 0, 1, 2, ..."""
    algorithm: str | None = None
    """Algorithm of a checksum."""
    data_id: tuple[int, ...] = ()
    """Bytes that come before the frame's own in a checksum."""
    modulo: int | None = None
    """Modulus of a counter; None: the signal's width."""


@dataclass(frozen=True, slots=True)
class OutputConfig:
    """One message that tpmsd sends in the car's own format."""

    message: str | None = None
    signals: tuple[tuple[str, OutputSignal], ...] = ()
    dbc: Path | None = None
    """None: the DBC of the bus."""
    bus: str | None = None
    """A name of [can.buses]; None: the bus of [can]."""
    when: str = "cyclic"
    """cyclic | change | both"""
    period_s: float = 0.1
    j1939: str | None = None
    """tire | dm1: a standard message instead."""
    source_address: int | None = None


@dataclass(frozen=True, slots=True)
class CanConfig:
    """The bus and where on it the signals are."""

    signals: dict[str, str]
    """Role -> 'Message.Signal'."""
    dbc: Path
    interface: str = "socketcan"
    channel: str = "can0"
    fd: bool = False
    bitrate: int | None = None
    options: dict[str, SignalOptions] = field(default_factory=dict)
    """Role -> what its table form says; roles given as plain names have none."""
    buses: dict[str, BusConfig] = field(default_factory=dict)
    """The further buses by name, in the order of the file."""
    output_ids: tuple[int, ...] = ()
    """Identifiers that `output` may send."""
    output: tuple[OutputConfig, ...] = ()

    def option(self, role: str) -> SignalOptions:
        """Return the options of a role; the defaults where it has none."""
        return self.options.get(role, _NO_OPTIONS)

    def bus_number(self, role: str) -> int:
        """Return the number of a role's bus: 0 for that of [can], else 1 and up in the order of
        [can.buses]."""
        name = self.option(role).bus
        return 0 if name is None else 1 + list(self.buses).index(name)


_NO_OPTIONS = SignalOptions()


@dataclass(frozen=True, slots=True)
class GnssConfig:
    """The receiver."""

    device: str | None = None
    source: str | None = None
    """serial:PATH | gpsd://HOST | tcp://HOST:PORT | udp://HOST:PORT | can; None: the serial line `device`."""
    baud: int = 115200
    antenna_forward_m: float = 0.0
    antenna_left_m: float = 0.0
    latency_s: float = 0.0
    """Known age of a fix on its fastest arrival; 0 where it is not known."""
    host_clock: str = "free"
    """free | utc: kept on UTC (by chrony, PTP, PPS), so that the age of a fix is known of each."""


@dataclass(frozen=True, slots=True)
class ObdConfig:
    """The car's own speed by OBD-II (SAE J1979, service 01, PID 0D), which has to be asked for."""

    speed: bool = False
    """True if the speed is requested: that sends a frame on the car's bus."""
    period_s: float = 1.0
    bus: str | None = None
    """A name of [can.buses]; None: the bus of [can]."""
    extended_ids: bool = False
    """The 29-bit identifiers of ISO 15765-4; else those of 11 bits."""

    @property
    def request_id(self) -> int:
        """Return the functional request identifier: all control units that know the service answer."""
        return 0x18DB33F1 if self.extended_ids else 0x7DF

    @property
    def answer_ids(self) -> range:
        """Return the identifiers of the answers."""
        return range(0x18DAF100, 0x18DAF200) if self.extended_ids else range(0x7E8, 0x7F0)

    def bus_number(self, can: CanConfig) -> int:
        """Return 0 for the bus of [can], else 1 and up in the order of [can.buses]."""
        return 0 if self.bus is None else 1 + list(can.buses).index(self.bus)


@dataclass(frozen=True, slots=True)
class FilterConfig:
    """The estimator."""

    method: str = DEFAULT_METHOD
    """One of FILTER_METHODS (`onboard/estimators/table.py`); mpf-rb is an earlier name of the default."""
    rate_hz: float = 10.0
    """Ticks per second, 1 to 100."""
    particles: int | None = None
    """None: the method's own default (gaussian-sum 40, those of samples 500, aug-ekf and aug-ukf none)."""
    window_s: float = 60.0
    """Memory of the forgetting factor: lambda = 1 - 1/(window_s * rate_hz) [Lundquist 2013, eq. 20]."""
    seed: int = 1
    min_speed_mps: float = 6.0
    """Below this the ticks are not informative of a radius and the heading may come from the steering, eq.
    (38)."""
    max_accel_long_mps2: float = 1.2
    max_accel_lat_mps2: float = 3.0
    gate: str = "thresholds"
    """One of FILTER_GATES: what decides which ticks are informative, accelerations or the slips that they
    cause."""
    max_wheel_slip: float = 0.005
    """Longitudinal slip of any wheel up to which a tick is informative, for the gate `slip`."""
    max_side_slip_rad: float = 0.05
    """Side slip of the rear axle up to which a tick is informative, rad."""
    fix_weights: str = "square"
    """One of FIX_WEIGHTS (gaussian-sum): how fast a fix that does not fit loses influence."""
    measurements: tuple[str, ...] = MEASUREMENTS
    """Those of MEASUREMENTS that are used, by every method alike; mpf-pn-paper uses positions and steering at
    most."""
    model: Path | None = None
    """A model file as `diagnose` writes it, to be compensated; --model takes its place."""


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """Thresholds at which a deviation is an alarm."""

    learn_s: float = 45.0
    """Informative driving before the baseline is frozen."""
    deflation_percent: float = 0.25
    """Loss of radius, in per cent of nominal, from which a wheel counts as deflated."""
    deflation_pressure_percent: float | None = None
    """Threshold as a loss of pressure, in per cent, by the table [tyre]; replaces the threshold on the
    radius."""
    deviation_percent: float = 0.8
    """Change of radius of either sign, in per cent of nominal, from which radius_deviation is raised."""
    raise_probability: float = 0.99
    """Probability of a loss from which an alarm is raised: the rate of false alarms falls with its distance
    from 1."""
    clear_probability: float = 0.2
    """Probability below which it is cleared."""
    raise_hold_s: float = 10.0
    """Driving time for which the probability must stay above before an alarm is raised."""
    clear_hold_s: float = 60.0
    malfunction_s: float = 30.0
    """Time without usable wheels before malfunction is raised."""
    gnss_malfunction_s: float = 300.0
    """Time of driving without fixes before it is raised."""
    resonance: bool = False
    """True if the torsional resonances of the wheels are used as evidence, too
    (docs/explanation/resonance.md)."""


@dataclass(frozen=True, slots=True)
class TyreConfig:
    """Tyre data that convert a loss of radius into a loss of pressure (`tpmsd.car.physics.tyre`)."""

    size: str | None = None
    """Size as on the side wall, say 205/60R15; None if not known."""
    load_n: float = 4000.0
    """Vertical load of one tyre."""
    pressure_kpa: float = 220.0
    """Nominal, above the atmosphere's."""
    stiffness_npm: float | None = None
    """Vertical, N/m; None: from the size."""
    curve_pressure_percent: tuple[float, ...] = ()
    """A measured curve: losses of pressure, rising, ..."""
    curve_radius_mm: tuple[float, ...] = ()
    """... and the loss of radius at each."""


@dataclass(frozen=True, slots=True)
class AlarmsConfig:
    """Alarm messages that are sent on the bus, as dbc/tpmsd.dbc describes them."""

    can: bool = True
    channel: str | None = None
    """None: the channel that is read."""
    status_id: int = 0x6F0
    alarm_id: int = 0x6F1
    reset_id: int | None = None
    """Identifier under which the bus may ask to learn the tyres again; None: it may not."""
    extended_ids: bool = False
    status_period_s: float = 1.0
    alarm_period_s: float = 0.5


@dataclass(frozen=True, slots=True)
class StatusConfig:
    """The Unix socket that `tpmsd status` asks."""

    socket: Path = Path("/run/tpmsd/status.sock")
    mode: int = 0o660


@dataclass(frozen=True, slots=True)
class NotifyConfig:
    """A program that is run when an alarm is raised or cleared."""

    command: tuple[str, ...] = ()
    """Program and arguments, no shell; empty: none."""
    kinds: tuple[str, ...] = ()
    """Kinds of alarms it is run for; empty: all."""
    min_interval_s: float = 5.0
    """Time from one start to the next, at least, s; events in between wait."""
    timeout_s: float = 30.0
    """Time after which the program is killed, s."""


@dataclass(frozen=True, slots=True)
class StateConfig:
    """State that is kept over restarts."""

    file: Path | None = Path("/var/lib/tpmsd/state.json")
    interval_s: float = 60.0


@dataclass(frozen=True, slots=True)
class CalibrationConfig:
    """Origin of the radii and tracks, as `tpmsd calibrate --write` notes it, and how well they are known: by
    it the monitor knows the tyres from the first drive on."""

    made: str | None = None
    method: str | None = None
    drives: str | None = None
    reference_speed_mps: float | None = None
    """The radii are those at this speed."""
    radius_std_fl_m: float | None = None
    radius_std_fr_m: float | None = None
    radius_std_rl_m: float | None = None
    radius_std_rr_m: float | None = None
    track_rear_std_m: float | None = None
    track_front_std_m: float | None = None
    bus_radius_fl_m: float | None = None
    """Radius by which speeds over the road on the bus were made rotation, on which the calibrated radii
    rest: with another one they would be others. None where the bus has counts or rotation."""
    bus_radius_fr_m: float | None = None
    bus_radius_rl_m: float | None = None
    bus_radius_rr_m: float | None = None

    @property
    def bus_radius_m(self) -> tuple[float | None, ...]:
        """Return `bus_radius_fl_m` and so on (m), in the order of `foundation.wheels`; None where not
        noted."""
        return self.bus_radius_fl_m, self.bus_radius_fr_m, self.bus_radius_rl_m, self.bus_radius_rr_m

    @property
    def radius_std_m(self) -> tuple[float | None, ...]:
        """Return the standard deviations of the four radii (m), in the order of `foundation.wheels`."""
        return self.radius_std_fl_m, self.radius_std_fr_m, self.radius_std_rl_m, self.radius_std_rr_m


@dataclass(frozen=True, slots=True)
class PhysicsConfig:
    """The catalogue of effects."""

    effects_path: Path | None = None
    """Folder of Python files with effects of one's own; not followed in a drive folder's own vehicle.toml."""


@dataclass(frozen=True, slots=True)
class VehicleStateConfig:
    """The filter of the vehicle state: speeds, side slip and yaw rate of the centre of gravity."""

    method: str | None = None
    """One of VEHICLE_STATE_METHODS; None: it is not estimated."""
    particles: int = 100
    """Number of particles of upf and arupf."""


@brief
@dataclass(frozen=True, slots=True)
class Config:
    """Everything the daemon knows before it starts."""

    vehicle: VehicleConfig
    can: CanConfig
    gnss: GnssConfig = field(default_factory=GnssConfig)
    obd: ObdConfig = field(default_factory=ObdConfig)
    filter: FilterConfig = field(default_factory=FilterConfig)
    monitor: MonitorConfig = field(default_factory=MonitorConfig)
    tyre: TyreConfig = field(default_factory=TyreConfig)
    alarms: AlarmsConfig = field(default_factory=AlarmsConfig)
    status: StatusConfig = field(default_factory=StatusConfig)
    state: StateConfig = field(default_factory=StateConfig)
    notify: NotifyConfig = field(default_factory=NotifyConfig)
    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    dynamics: DynamicsConfig = field(default_factory=DynamicsConfig)
    vehicle_state: VehicleStateConfig = field(default_factory=VehicleStateConfig)
    file: Path | None = None
    """File from which the configuration was read."""

    def bus_radius_m(self, wheel: int) -> float:
        """Return the radius (m) by which a wheel's road speed is divided to give its rotation rate."""
        return self.calibration.bus_radius_m[wheel] or self.vehicle.wheel_radius_m[wheel]

    @property
    def bus_radii_m(self) -> dict[str, float]:
        """Return wheel -> `bus_radius_m` for the wheels whose speed is on the bus."""
        return {
            role.rpartition("_")[2]: self.bus_radius_m(index)
            for index, role in enumerate(WHEEL_SPEED_ROLES)
            if role in self.can.signals
        }

    @property
    def calibration_holds(self) -> bool:
        """Return whether the calibrated radii are valid: not if they rest on speeds of the bus without the
        radius that made them rotation (0.1 did not note it)."""
        return all(
            role not in self.can.signals or radius_m is not None
            for role, radius_m in zip(WHEEL_SPEED_ROLES, self.calibration.bus_radius_m, strict=True)
        )
