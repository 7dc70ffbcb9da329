"""The common frame of the baselines of vehicle dynamics: forces to rates, rates to a step, states to
readings.

In: states (..., n), inputs of shape (...), effects. Out: arrays of the same leading shape; the leading axes
are time, parameters or none. A baseline is a car with contacts: two axles with linear tyres, or four wheels
with Dugoff's.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from operator import is_
from typing import ClassVar

import numpy as np

from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.exponential import MAX_DECAY, exponential_step
from tpmsd.car.physics.baselines.frame import (
    Earlier,
    Frame,
    Real,
    Unlimited,
    frame_of,
    is_zero,
    like,
    stack_contacts,
)
from tpmsd.car.physics.baselines.inputs import Inputs, Span
from tpmsd.car.physics.dynamics_effect import DynamicsEffect, effects_before_forces, sorted_by_order
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.wheels import FloatArray

Theta = Sequence[DynamicsEffect]
"""Parameters of an extended baseline: the effects with their values; none leaves the baseline as
configured."""
MIN_MPS = 2.0
"""Slip angles are those of at least this speed: slower, their geometry is singular."""
UNITS = {
    "yaw_rate": "rad/s",
    "accel_long": "m/s2",
    "accel_lat": "m/s2",
    "speed": "m/s",
    "velocity_lat": "m/s",
    "side_slip": "rad",
    "roll": "rad",
}
"""Outputs by name, with their units."""
SHARE_MARGIN = 0.02
"""Step by which a share of force may leave 0 and 1: more than the difference of a derivative, less than
shows.
"""
MAX_STIFF = 0.8
"""Largest rate constant times step of the integration."""
INSTANT_ROUNDS = 2
"""Rounds from the steady accelerations to the instantaneous ones: 4 m/s2 apart they leave 0.03 m/s2."""


@dataclass(frozen=True, slots=True)
class Rolled:
    """An evaluation up to the tyres' forces."""

    frame: Frame
    effects: tuple[DynamicsEffect, ...]
    """Those that act before the tyres' forces are known."""

    def has_same_early_effects(self, theta: Theta) -> bool:
        """Return True if the same effect objects act before the tyres' forces as in this evaluation."""
        others = effects_before_forces(theta)
        return len(others) == len(self.effects) and all(map(is_, others, self.effects))

    def copy_frame(self) -> Frame:
        """Return a copy of the frame that effects may change; this evaluation stays as it is."""
        frame = copy(self.frame)
        frame.force_x, frame.force_y, frame.moment = (
            np.array(one) for one in (frame.force_x, frame.force_y, frame.moment)
        )
        frame.rates, frame.outputs, frame.delays = dict(frame.rates), dict(frame.outputs), dict(frame.delays)
        frame.earlier = {}
        return frame


@dataclass(frozen=True, slots=True)
class Baseline(ABC):
    """A baseline of one car; `forces` says that drive and brake forces are inputs and speed a state,
    `of_speed` that the longitudinal acceleration is du/dt: the specific force is du/dt - v r.
    """

    car: DynamicCar
    forces: bool = False
    of_speed: bool = False
    name: ClassVar[str] = ""
    nonlinear: ClassVar[bool] = False

    def states(self, theta: Theta = ()) -> tuple[str, ...]:
        """Return the names of the states: v, r, u where speed is an output, and those that effects add."""
        extra = [state for effect in theta for state in effect.states]
        return ("v", "r", *(("u",) if self.forces else ()), *dict.fromkeys(extra))

    def outputs(self, theta: Theta = ()) -> tuple[str, ...]:
        """Return the names of the predicted outputs."""
        speed = ("speed", "accel_long") if self.forces else ()
        roll = ("roll",) if "roll" in self.states(theta) else ()
        return ("yaw_rate", "accel_lat", "velocity_lat", "side_slip", *speed, *roll)

    def step(
        self,
        x: FloatArray,
        u: Inputs | Span,
        theta: Theta,
        dt: float | FloatArray,
        start_rates: FloatArray | None = None,
    ) -> FloatArray:
        """Return the states after `dt` seconds, (..., n); `u` is held, or a `Span` that changes linearly.

        Runge-Kutta of fourth order, in as many steps as the fastest rate needs, exponential where states
        follow what drives them. `start_rates` are those of the first stage where they are known.
        """
        decays = self._decay_rates_by_column(x, u.at(0.0), theta)
        if decays:
            return self._exponential_steps(x, u, theta, dt, decays, start_rates)
        count = self.substeps(u.at(0.0), float(np.max(dt)), theta)
        h = np.asarray(dt)[..., None] / count
        for k in range(count):
            first, middle, last = (u.at((k + part) / count) for part in (0.0, 0.5, 1.0))
            a = self.rates(x, first, theta) if k or start_rates is None else start_rates
            b = self.rates(x + 0.5 * h * a, middle, theta)
            c = self.rates(x + 0.5 * h * b, middle, theta)
            d = self.rates(x + h * c, last, theta)
            x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        return x

    def _decay_rates_by_column(self, x: FloatArray, u: Inputs, theta: Theta) -> dict[int, FloatArray]:
        """Return the rate constants (...), 1/s, of the states with first-order lag, by their columns."""
        names = self.states(theta)
        speed = np.maximum(x[..., names.index("u")] if "u" in names else u.speed_mps, MIN_MPS)
        return {
            names.index(name): constant
            for effect in theta
            for name, constant in effect.decays_per_s(speed).items()
        }

    def _exponential_steps(
        self,
        x: FloatArray,
        u: Inputs | Span,
        theta: Theta,
        dt: float | FloatArray,
        decays: Mapping[int, FloatArray],
        start_rates: FloatArray | None,
    ) -> FloatArray:
        """Return the states after `dt` seconds by exponential steps with these rate constants."""
        names, longest = self.states(theta), float(np.max(dt))
        others = [one for one in theta if not any(names.index(name) in decays for name in one.states)]
        fastest = max(float(np.max(constant)) for constant in decays.values())
        count = max(self.substeps(u.at(0.0), longest, others), math.ceil(longest * fastest / MAX_DECAY))
        h = np.asarray(dt)[..., None] / count
        for k in range(count):

            def rates(at: FloatArray, fraction: float, begin: int = k) -> FloatArray:
                return self.rates(at, u.at((begin + fraction) / count), theta)

            first = rates(x, 0.0) if k or start_rates is None else start_rates
            x = exponential_step(x, first, rates, h, decays)
        return x

    def substeps(self, u: Inputs, dt: float, theta: Theta = ()) -> int:
        """Return the number of integration steps, a power of 2, for stability and accuracy at all speeds."""
        stiff = self._fastest_rate_per_s(u, theta)
        return int(2 ** np.ceil(np.log2(max(dt * stiff / MAX_STIFF, 1.0))))

    def _fastest_rate_per_s(self, u: Inputs, theta: Theta) -> float:
        """Return the fastest rate constant of car and effects at these speeds, 1/s."""
        slowest = max(float(np.min(u.speed_mps)), MIN_MPS)
        mass = self.car.mass_kg * math.prod(effect.mass_share() for effect in theta)
        stiff = (self.car.cornering_front_n + self.car.cornering_rear_n) / (mass * slowest)
        fastest = float(np.max(u.speed_mps))
        return max([stiff, *(effect.fastest_rate_per_s(fastest) for effect in theta)])

    def rates(self, x: FloatArray, u: Inputs, theta: Theta) -> FloatArray:
        """Return the time derivatives of the states, (..., n)."""
        names = self.states(theta)
        frame = self._evaluate_rates(
            {name: x[..., k] for k, name in enumerate(names)}, u, sorted_by_order(theta)
        )
        rates = [frame.rates[name] for name in names]
        return np.stack(np.broadcast_arrays(*rates), axis=-1)

    def read(self, x: FloatArray, u: Inputs, theta: Theta) -> dict[str, FloatArray]:
        """Return the instruments' readings by the output's name."""
        return self.frame(x, u, theta).outputs

    def frame(
        self,
        x: FloatArray,
        u: Inputs,
        theta: Theta,
        states: Sequence[str] | None = None,
        rolled: Rolled | None = None,
        read: bool = True,
        late: bool = True,
        earlier: Mapping[str, Earlier] | None = None,
    ) -> Frame:
        """Return everything of one evaluation, readings included.

        `states` names those of x where they are not all that the effects have: an effect without its states
        acts to first order. `rolled` is an evaluation of the same states and inputs; it is used where the
        tyres cannot tell the effects from its own. Without `read` there are no readings, unless `late` they
        have no ages. `earlier` are earlier evaluations of a model that moves as this one does.
        """
        names = self.states(theta) if states is None else states
        state = {name: x[..., k] for k, name in enumerate(names)}
        theta = sorted_by_order(theta)
        if rolled is not None and rolled.has_same_early_effects(theta):
            frame = self._add_forces_and_rates(rolled.copy_frame(), theta)
        else:
            frame = self._evaluate_rates(state, u, theta)
        if read:
            self._fill_readings(frame, theta)
        if frame.delays and late:
            self._delay_readings(frame, state, u, theta, earlier or {})
        return frame

    def evaluate_to_tyre_forces(
        self, x: FloatArray, u: Inputs, theta: Theta, states: Sequence[str] | None = None
    ) -> Rolled:
        """Return an evaluation up to the tyres' forces, for models that differ in what follows them."""
        names = self.states(theta) if states is None else states
        theta = sorted_by_order(theta)
        return Rolled(
            self._evaluate_tyre_forces({name: x[..., k] for k, name in enumerate(names)}, u, theta),
            effects_before_forces(theta),
        )

    def _evaluate_rates(self, state: Mapping[str, FloatArray], u: Inputs, theta: Theta) -> Frame:
        """Return a new frame with all forces and the rates of the states."""
        return self._add_forces_and_rates(self._evaluate_tyre_forces(state, u, theta), theta)

    def _evaluate_tyre_forces(self, state: Mapping[str, FloatArray], u: Inputs, theta: Theta) -> Frame:
        """Return a new frame up to the tyres' forces, effects on them applied."""
        frame = frame_of(self.car, state, u, self.nonlinear, MIN_MPS)
        if self.of_speed:
            frame.accel_long = frame.accel_long - frame.v * frame.r
        for effect in theta:
            effect.adapt_car(frame)
        for effect in theta:
            effect.adapt_inputs(frame)
        if not self.forces:
            force = frame.mass * frame.accel_long + drag_and_rolling_resistance_n(frame)
            frame.drive, frame.brake = np.maximum(force, 0.0), np.maximum(-force, 0.0)
        frame.load_accel_long = (frame.drive - frame.brake) / frame.mass if self.forces else frame.accel_long
        frame.load_accel_lat = frame.u * frame.r
        if not is_zero(frame.instant_loads) or any(effect.follows_instant() for effect in theta):
            if not any(effect.acts_on_angles and effect.reads_loads for effect in theta):
                self._set_unlimited_forces(frame, theta)  # the same in each round
            self._iterate_load_accelerations(frame, theta)
        self._apply_loads_and_tyres(frame, theta)
        return frame

    def _iterate_load_accelerations(self, frame: Frame, theta: Theta) -> None:
        """Set the accelerations that loads and roll follow to those of the tyres' forces, by fixed-point
        iteration: loads depend on accelerations, forces on loads.

        Each round uses the forces of the loads before, so that the error falls by the tyres' sensitivity to
        load, a fifth near the limit.
        """
        steady = frame.load_accel_lat, frame.load_accel_long
        frame.tyre_accel_lat = frame.load_accel_lat
        for _ in range(INSTANT_ROUNDS):
            first = copy(frame)
            self._apply_loads_and_tyres(first, theta)
            frame.tyre_accel_lat = np.asarray(first.force_y / frame.mass)
            frame.load_accel_lat = steady[0] + frame.instant_loads * (frame.tyre_accel_lat - steady[0])
            if self.forces:
                accel = np.asarray((first.force_x - drag_and_rolling_resistance_n(frame)) / frame.mass)
                frame.load_accel_long = steady[1] + frame.instant_loads * (accel - steady[1])

    def _apply_loads_and_tyres(self, frame: Frame, theta: Theta) -> None:
        """Fill in loads and tyre forces for the accelerations of the frame."""
        self._fill_loads(frame)
        for effect in theta:
            effect.adapt_loads(frame)
        if frame.unlimited is None:
            self._set_unlimited_forces(frame, theta)
        self._fill_tyre_forces(frame)

    def _set_unlimited_forces(self, frame: Frame, theta: Theta) -> None:
        """Fill in slip angles, stiffnesses and the tyre forces without a limit of friction."""
        self._fill_slip_angles(frame)
        for effect in theta:
            effect.adapt_angles(frame)
        for effect in theta:
            effect.adapt_tyres(frame)
        frame.unlimited = self._unlimited_forces(frame)

    def _add_forces_and_rates(self, frame: Frame, theta: Theta) -> Frame:
        """Add all other forces and the rates to a frame with tyre forces; return it."""
        for effect in theta:
            effect.add_forces(frame)
        _add_drag_and_rolling_resistance(frame)
        frame.rates["v"] = frame.force_y / frame.mass - frame.u * frame.r + frame.gravity_y
        frame.rates["r"] = np.asarray(frame.moment / frame.inertia)
        frame.rates["u"] = np.asarray(frame.force_x / frame.mass + frame.v * frame.r + frame.gravity_x)
        for effect in theta:
            effect.add_rates(frame)
        return frame

    def _fill_readings(self, frame: Frame, theta: Theta) -> None:
        """Fill in the readings of perfect instruments at the centre of gravity, then those of the effects."""
        frame.outputs = {
            "yaw_rate": frame.r,
            "accel_lat": np.asarray(frame.force_y / frame.mass),
            "velocity_lat": frame.v,
            "side_slip": frame.v / frame.u,
        }
        if self.nonlinear:
            frame.outputs["side_slip"] = np.arctan2(frame.v, frame.u)
        if self.forces:
            frame.outputs["speed"] = frame.u
            frame.outputs["accel_long"] = np.asarray(frame.force_x / frame.mass)
        if "roll" in frame.extra:
            frame.outputs["roll"] = frame.extra["roll"]
        for effect in theta:
            effect.read(frame)

    def _delay_readings(
        self,
        frame: Frame,
        state: Mapping[str, FloatArray],
        u: Inputs,
        theta: Theta,
        known: Mapping[str, Earlier],
    ) -> None:
        """Replace readings that have an age T by y(t - T), read in the state that the car had then.

        That state is integrated backwards over the recorded inputs; that of an older reading goes on from the
        younger one's where both ages are single numbers of one sign. It is a `known` one of the same age.
        """
        before, past, done = frame, state, np.zeros(())
        for name, delay in sorted(frame.delays.items(), key=lambda pair: float(np.max(np.abs(pair[1])))):
            age = np.asarray(delay)
            if age.ndim > 0 or done.ndim > 0 or age * done < 0.0:
                before, past, done = frame, state, np.zeros(())
            near = known.get(name) if age.ndim == 0 else None
            if near is not None and age == near.age_s:
                before, past, done = near.again(), near.state, near.age_s
            if before is frame or np.any(age != done):
                past, then = self._integrate_backwards(before, past, u, theta, age, done)
                before, done = self._evaluate_rates(past, then, theta), age
            self._fill_readings(before, theta)
            frame.outputs[name] = before.outputs[name]
            frame.earlier[name] = Earlier(age, past, before)

    def _integrate_backwards(
        self,
        frame: Frame,
        state: Mapping[str, FloatArray],
        u: Inputs,
        theta: Theta,
        delay: FloatArray,
        done: FloatArray,
    ) -> tuple[Mapping[str, FloatArray], Inputs]:
        """Return states and inputs `delay` seconds ago, states by Runge-Kutta's method of fourth order.

        `frame` and `state` are those of a time `done` ago, inputs those of now. Spans below a tenth of the
        fastest time constant take the midpoint rule, whose error is as small there. States of effects that
        forget within the age are left out, since an error in them would grow by more than e: there the
        effects act to first order.
        """
        longest, fastest = float(np.max(np.abs(delay))), float(np.max(u.speed_mps))
        kept = [effect for effect in theta if longest * effect.fastest_rate_per_s(fastest) <= 1.0]
        own = {"v", "r", "u", *(name for effect in kept for name in effect.states)}
        gone = not own.issuperset(state)
        state = {name: values for name, values in state.items() if name in own}
        span = delay - done
        count = self.substeps(u, float(np.max(np.abs(span))), kept)
        stiff = float(np.max(np.abs(span))) * self._fastest_rate_per_s(u, kept)
        h = span / count

        def stepped_back(by: FloatArray, rates: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
            return {key: value - by * rates[key] for key, value in state.items()}

        for k in range(count):
            begin = done + k * h
            first = (
                frame.rates
                if k == 0 and not gone
                else self._evaluate_rates(state, u.shifted(-begin), theta).rates
            )
            middle = u.shifted(-(begin + 0.5 * h))
            second = self._evaluate_rates(stepped_back(0.5 * h, first), middle, theta).rates
            if stiff < 0.1:
                return stepped_back(h, second), u.shifted(-delay)
            third = self._evaluate_rates(stepped_back(0.5 * h, second), middle, theta).rates
            last = self._evaluate_rates(stepped_back(h, third), u.shifted(-(begin + h)), theta).rates
            mean = {
                key: (first[key] + 2.0 * second[key] + 2.0 * third[key] + last[key]) / 6.0 for key in state
            }
            state = stepped_back(h, mean)
        return state, u.shifted(-delay)

    @abstractmethod
    def _fill_loads(self, frame: Frame) -> None:
        """Fill in `load` and `transfer`."""

    @abstractmethod
    def _fill_slip_angles(self, frame: Frame) -> None:
        """Fill in `angle` and `stiffness`."""

    @abstractmethod
    def _unlimited_forces(self, frame: Frame) -> Unlimited:
        """Return the tyres' forces without a limit of friction."""

    @abstractmethod
    def _fill_tyre_forces(self, frame: Frame) -> None:
        """Fill in `side` and `along`, and their sums `force_x`, `force_y` and `moment`."""


def _add_drag_and_rolling_resistance(frame: Frame) -> None:
    """Add drag and rolling resistance, where the car has them and speed is an output."""
    if frame.speed_is_state:
        frame.force_x = frame.force_x - drag_and_rolling_resistance_n(frame)


def drag_and_rolling_resistance_n(frame: Frame) -> FloatArray:
    """Return drag and rolling resistance of the configured car and of the effects, N."""
    drag = 0.5 * frame.air_kgpm3 * frame.drag_area * frame.u * np.abs(frame.u)
    return np.asarray(drag + frame.rolling_resistance * frame.mass * GRAVITY_MPS2)


def axle_forces(frame: Frame) -> tuple[Real, Real]:
    """Return the longitudinal force of the front and of the rear axle: their shares of drive and brake
    force."""
    front = (
        clipped_share(frame.drive_front_share) * frame.drive
        - clipped_share(frame.brake_front_share) * frame.brake
    )
    rear = (1.0 - clipped_share(frame.drive_front_share)) * frame.drive
    return front, rear - (1.0 - clipped_share(frame.brake_front_share)) * frame.brake


def clipped_share(share: Real) -> Real:
    """Return a share clipped to 0..1 and a margin beyond, so that it has a derivative at 0 and at 1."""
    return np.clip(share, -SHARE_MARGIN, 1.0 + SHARE_MARGIN)


def lateral_transfer(frame: Frame) -> FloatArray:
    """Return the lateral load transfer of each axle over its wheel's static load, (2, ...).

    Each axle takes the transfer of the mass that it carries: dF / F0 = 2 h a_y / (g t).
    """
    pull = 2.0 * frame.height * frame.load_accel_lat / GRAVITY_MPS2
    return stack_contacts(pull / frame.track_front, pull / frame.track_rear)


def pad_axes(*arrays: FloatArray) -> list[FloatArray]:
    """Return arrays of contacts (k, ...), padded by axes of length one to the most axes of any."""
    longest = max(arrays, key=lambda one: one.ndim)
    return [like(one, longest) for one in arrays]
