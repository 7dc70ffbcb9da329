"""One evaluation of a car: every quantity from parameters and state to forces and readings, in order.

In: a car, states and inputs. Out: `Frame`, which a baseline fills stage by stage; between the stages the
effects of the model change what is there. Arrays of contacts have the contact first: (2, ...) for axles,
(4, ...) for wheels fl fr rl rr; the other axes are time, parameters or none and broadcast together.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field

import numpy as np

from tpmsd.car.physics.air import AIR_KGPM3
from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.inputs import Inputs
from tpmsd.foundation.wheels import FloatArray

Real = float | FloatArray


@dataclass(frozen=True, slots=True)
class Earlier:
    """The evaluation in which a delayed output is read."""

    age_s: FloatArray
    """Age of the reading."""
    state: Mapping[str, FloatArray]
    frame: Frame
    """Its inputs are those of then."""

    def again(self) -> Frame:
        """Return the evaluation for other instruments."""
        frame = copy(self.frame)
        frame.outputs, frame.delays = {}, {}
        return frame


@dataclass(frozen=True, slots=True)
class Unlimited:
    """Tyre forces without a limit of friction, in the wheels' frames, (contacts, ...) each."""

    side: FloatArray
    """N."""
    along: FloatArray
    """N."""
    total: FloatArray
    """Size of their sum as vectors, N."""
    cos: FloatArray
    """Cosine of the front wheels' angle, (...)."""
    sin: FloatArray
    """Sine of the front wheels' angle, (...)."""


@dataclass(slots=True)
class Frame:
    """Quantities of one evaluation; SI units, x forward, y left, moments counter-clockwise."""

    inputs: Inputs
    v: FloatArray
    """Lateral speed of the centre of gravity, m/s."""
    u: FloatArray
    """Longitudinal speed, at least the baseline's least speed, m/s."""
    r: FloatArray
    """Yaw rate, rad/s."""
    extra: Mapping[str, FloatArray]
    """States that effects add, by name."""
    nonlinear: bool
    """False where the tyres are linear and the angles small."""
    speed_is_state: bool

    # the car as the effects see it
    mass: Real
    inertia: Real
    front: Real
    """Distance of the front axle from the centre of gravity, m."""
    rear: Real
    """Distance of the rear axle from the centre of gravity, m."""
    height: Real
    """Height of the centre of gravity, m."""
    track_front: Real
    track_rear: Real
    cornering_front: Real
    cornering_rear: Real
    longitudinal: Real
    """Longitudinal slip stiffness of a wheel, N."""
    friction: Real | None
    """None where the tyres have no limit."""
    tyre_shape: Real = field(default=0.0, kw_only=True)
    """Law between linear and sliding: 0 Dugoff's, 1 the brush model's, -1 the Magic Formula's."""
    ellipse: Real = field(default=0.0, kw_only=True)
    """Share of the friction ellipse in how longitudinal force takes side force; 0: the baseline's own way."""
    wheel_loads: Real = field(default=0.0, kw_only=True)
    """Share of the lateral load transfer that friction of an axle's two wheels feels; axles only."""
    instant_loads: Real = field(default=0.0, kw_only=True)
    """Share of what loads and roll follow of the accelerations beside the steady ones."""
    air_kgpm3: Real = field(default=AIR_KGPM3, kw_only=True)
    """Density of the air."""
    drive_front_share: Real
    brake_front_share: Real
    drag_area: Real
    rolling_resistance: Real
    steering_ratio: Real

    # inputs as they act
    steer: FloatArray
    drive: FloatArray
    brake: FloatArray
    accel_long: FloatArray

    # stage by stage
    load_accel_long: Real = field(default=0.0, kw_only=True)
    """Longitudinal acceleration that loads follow, m/s2."""
    load_accel_lat: Real = field(default=0.0, kw_only=True)
    """Lateral acceleration that loads and roll follow, m/s2."""
    tyre_accel_lat: Real = field(default=0.0, kw_only=True)
    """Lateral acceleration that the tyres give, m/s2, where an effect follows it."""
    roll_accel: FloatArray | None = field(default=None, kw_only=True)
    """Lateral acceleration at which a steady bend has the present roll angle, m/s2, where it is a state."""
    roll_delay: Real = field(default=0.0, kw_only=True)
    """Time by which slow roll lags the lateral acceleration, s, where it is no state."""
    roll_square: Real = field(default=0.0, kw_only=True)
    """One over the angular frequency of roll, squared, s2, where it is no state."""
    load: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(contacts, ...) N."""
    transfer: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(2, ...) lateral load transfer of each axle over its wheel's static load, signed: positive in a left
    turn."""
    angle: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(contacts, ...) slip angles, positive where the force points left."""
    stiffness: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(contacts, ...) cornering stiffness, N/rad."""
    unlimited: Unlimited | None = None
    """Forces of tyres without a limit, where they are known."""
    turned_front: Real = field(default=0.0, kw_only=True)
    """Angle to the left that the suspension adds to the front wheels' steer angle."""
    turned_rear: Real = field(default=0.0, kw_only=True)
    """Angle to the left by which the forces of the rear wheels are turned."""
    side: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(contacts, ...) lateral tyre forces in the wheel's frame, N."""
    along: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(contacts, ...) longitudinal tyre forces in the wheel's frame, N."""
    force_x: Real = 0.0
    """External and summed forces on the car, N; those that an accelerometer feels."""
    force_y: Real = 0.0
    moment: Real = 0.0
    gravity_x: Real = 0.0
    """Accelerations by gravity, which no accelerometer feels, m/s2."""
    gravity_y: Real = 0.0
    rates: dict[str, FloatArray] = field(default_factory=dict)
    """Time derivatives of the states by name."""
    outputs: dict[str, FloatArray] = field(default_factory=dict)
    """Readings by the output's name."""
    delays: dict[str, Real] = field(default_factory=dict)
    """Age of a reading by the output's name, s."""
    earlier: dict[str, Earlier] = field(default_factory=dict)
    """Evaluations at these ages by the output's name, the youngest first."""

    @property
    def axles(self) -> bool:
        """True if the contacts are the two axles, False if they are the four wheels."""
        return len(self.angle) == 2

    def lagged_by_roll(self, accel: Real) -> Real:
        """Return a lateral acceleration as the effects of the body's roll feel it: lagged, see `roll_lag`."""
        if self.roll_accel is not None:
            return self.roll_accel
        if is_zero(self.roll_delay) and is_zero(self.roll_square):
            return accel
        time_s = self.inputs.time_s
        if np.ndim(time_s) == 0 or np.shape(accel)[-1:] != np.shape(time_s) or len(time_s) < 2:
            return accel
        rate = np.gradient(accel, time_s, axis=-1)
        return accel - self.roll_delay * rate - self.roll_square * np.gradient(rate, time_s, axis=-1)

    def turn(self, front: Real, rear: Real, share: Real = 1.0) -> None:
        """Turn the wheels of both axles to the left, rad: their slip angles, and where their forces point, at
        the rear by a `share` of it."""
        turned = (front, rear) if self.axles else (front, front, rear, rear)
        self.angle = self.angle + like(stack_contacts(*turned), self.angle)
        self.turned_front = self.turned_front + front
        self.turned_rear = self.turned_rear + share * rear


def stack_contacts(*values: Real) -> FloatArray:
    """Return values of contacts, which broadcast together, as one array (contacts, ...).

    NumPy's own functions for it take longer than the arithmetic on a drive of some minutes.
    """
    out = np.empty((len(values), *np.broadcast(*values).shape))
    for contact, value in enumerate(values):
        out[contact] = value
    return out


def sine(angle: FloatArray) -> FloatArray:
    """Return the sine of angles within a half turn, by the tangent of half of each: within rounding the same
    as NumPy's, and faster."""
    half = np.tan(0.5 * angle)
    return np.asarray(2.0 * half / (1.0 + half * half))


def like(contacts: FloatArray, shape: FloatArray) -> FloatArray:
    """Return values of contacts (k, ...) with axes of one put in behind the first, as many as `shape` has."""
    missing = max(shape.ndim - contacts.ndim, 0)
    return contacts.reshape((len(contacts),) + (1,) * missing + contacts.shape[1:])


def is_zero(value: Real) -> bool:
    """Return True if a quantity is the number zero that it is unless an effect sets it."""
    return isinstance(value, float) and value == 0.0


def frame_of(
    car: DynamicCar, state: Mapping[str, FloatArray], inputs: Inputs, nonlinear: bool, min_mps: float
) -> Frame:
    """Return a frame with the car, the inputs and the states as they are before any effect."""
    speed_is_state = "u" in state
    speed = state["u"] if speed_is_state else inputs.speed_mps
    return Frame(
        inputs=inputs,
        v=state["v"],
        u=np.maximum(speed, min_mps),
        r=state["r"],
        extra={name: value for name, value in state.items() if name not in ("u", "v", "r")},
        nonlinear=nonlinear,
        speed_is_state=speed_is_state,
        mass=car.mass_kg,
        inertia=car.yaw_inertia_kgm2,
        front=car.front_m,
        rear=car.rear_m,
        height=car.height_m,
        track_front=car.track_front_m,
        track_rear=car.track_rear_m,
        cornering_front=car.cornering_front_n,
        cornering_rear=car.cornering_rear_n,
        longitudinal=car.longitudinal_n,
        friction=car.friction if nonlinear else None,
        drive_front_share=car.drive_front_share,
        brake_front_share=car.brake_front_share,
        drag_area=car.drag_area_m2,
        rolling_resistance=car.rolling_resistance,
        steering_ratio=car.steering_ratio,
        steer=inputs.steer_rad,
        drive=inputs.drive_n,
        brake=inputs.brake_n,
        accel_long=inputs.accel_long_mps2,
    )
