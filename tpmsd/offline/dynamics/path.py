"""The path of a drive: states and disturbances that steps and readings agree on best, and its derivatives.

In: a baseline with effects, a drive, noise. Out: `Linear`: residuals of steps and readings at a path with
their derivatives by the states; `smoothed`, the path by Gauss-Newton over the whole drive at once. All
evaluations are vectorised over time. The estimate is the fixed-interval Kalman smoother's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from tpmsd.car.physics.baselines.base import Baseline, Rolled, Theta
from tpmsd.car.physics.baselines.frame import Earlier, Frame
from tpmsd.car.physics.baselines.inputs import Inputs, Span
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.car.physics.dynamics_effects.time_spline import COVARIATES, covariate_of
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.arrays import BoolArray, IntArray
from tpmsd.offline.dynamics.banded import BandedFactor
from tpmsd.offline.dynamics.drive import DynamicsDrive, filled
from tpmsd.offline.dynamics.noise import PathNoise
from tpmsd.offline.dynamics.settings import SETTINGS

_STEP = 1e-6
"""One-sided difference of a state: its own error and that of rounding stay below 1e-6 of a derivative."""


@dataclass(frozen=True)
class Disturbance(DynamicsEffect):
    """Accelerations that belong to no term: F_x / m, F_y / m and M_z / I_z."""

    name = "disturbance"
    force_x: FloatArray | float = 0.0
    force_y: FloatArray | float = 0.0
    moment: FloatArray | float = 0.0

    def add_forces(self, frame: Frame) -> None:
        """Add the accelerations as forces and moment."""
        frame.force_x = frame.force_x + frame.mass * self.force_x
        frame.force_y = frame.force_y + frame.mass * self.force_y
        frame.moment = frame.moment + frame.inertia * self.moment


@dataclass(frozen=True)
class Setup:
    """A baseline on a drive: which states, disturbances and outputs take part."""

    baseline: Baseline
    drive: DynamicsDrive
    channels: tuple[str, ...]

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Return the names of the disturbances that are estimated."""
        return ("force_y", "moment", *(("force_x",) if self.baseline.forces else ()))

    def states(self, theta: Theta) -> tuple[str, ...]:
        """Return the names of the baseline's states with these effects."""
        return self.baseline.states(theta)

    def sizes(self, theta: Theta) -> dict[str, float]:
        """Return the sizes of the states by name, in their order; those of the baseline's own count as 1."""
        own = {name: size for effect in theta for name, size in effect.sizes_of_states().items()}
        return {name: own.get(name, 1.0) for name in self.states(theta)}

    def inputs(self, theta: Theta) -> Inputs:
        """Return the inputs as effects shift them."""
        inputs = self.drive.inputs
        for effect in theta:
            inputs = effect.shift_series(inputs)
        return inputs

    def readings(self) -> FloatArray:
        """Return the readings, (n, m); NaN where there is none or the car is too slow."""
        if not self.channels:
            return np.zeros((len(self.drive.time_s), 0))
        out = np.stack([self.drive.outputs[name] for name in self.channels], axis=1)
        return np.where(self.drive.moving[:, None], out, np.nan)

    def split_path(self, path: FloatArray, count: int) -> tuple[FloatArray, Disturbance]:
        """Return the first `count` columns of a path (states), and the rest as a `Disturbance`."""
        free = {name: path[..., count + k] for k, name in enumerate(self.disturbances)}
        return path[..., :count], Disturbance(**free)

    def evaluate(
        self,
        path: FloatArray,
        inputs: Inputs,
        theta: Theta,
        states: Sequence[str] | None = None,
        rolled: Rolled | None = None,
        late: bool = True,
        earlier: Mapping[str, Earlier] | None = None,
    ) -> tuple[FloatArray, FloatArray, Mapping[str, Earlier]]:
        """Return rates (s, n) and predicted readings (m, n) at the rows, and where delayed ones are read;
        `states` are those of the path, `rolled` and `earlier` are evaluations that serve the model; unless
        `late` readings have no ages.
        """
        names = self.states(theta) if states is None else states
        state, free = self.split_path(path, len(names))
        read = len(self.channels) > 0
        frame = self.baseline.frame(state, inputs, (*theta, free), names, rolled, read, late, earlier)
        rates, outputs = np.empty((len(names), len(path))), np.empty((len(self.channels), len(path)))
        for k, name in enumerate(names):
            rates[k] = frame.rates[name]
        for k, name in enumerate(self.channels):
            outputs[k] = frame.outputs[name]
        return rates, outputs, frame.earlier

    def start(self, theta: Theta) -> FloatArray:
        """Return a path to start from: readings where there are any, else rest."""
        drive, names = self.drive, self.states(theta)
        path = np.zeros((len(drive.time_s), len(names) + len(self.disturbances)))
        for state, output in (("v", "velocity_lat"), ("r", "yaw_rate"), ("u", "speed")):
            if state in names and output in drive.outputs:
                path[:, names.index(state)] = filled(drive.time_s, drive.outputs[output])
        return path


def covariates_of(setup: Setup, theta: Theta, path: FloatArray) -> dict[str, FloatArray]:
    """Return the covariates of terms without a name along a path, (n,) each."""
    names = setup.states(theta)
    state, free = setup.split_path(path, len(names))
    frame = setup.baseline.frame(state, setup.inputs(theta), (*theta, free), names)
    return {name: np.broadcast_to(covariate_of(frame, name), path.shape[:1]) for name in COVARIATES}


@dataclass(frozen=True)
class Linear:
    """Steps and readings at a path; n rows, n - 1 steps, t = s + d states with disturbances, m outputs."""

    path: FloatArray
    """(n, t)"""
    step_residual: FloatArray
    """(n - 1, t) path at the next row minus what the step gives; 0 between blocks."""
    reading_residual: FloatArray
    """(n, m) reading minus prediction; NaN where there is none."""
    by_state: FloatArray
    """(n - 1, t, t) of the step."""
    outputs_by_state: FloatArray
    """(n, m, t)"""
    by_rates: FloatArray
    """(2, n - 1, s, s) of the step, by what is added to the rates at its start and at its end, linear between
    them; 0 between blocks, empty unless the disturbances count."""
    _weighted: list[tuple[PathNoise, Weighted]] = field(default_factory=list, compare=False, repr=False)

    def weighted(self, setup: Setup, noise: PathNoise) -> Weighted:
        """Return the problem weighted by the noise; the last one is cached."""
        if not self._weighted or self._weighted[0][0] is not noise:
            self._weighted[:] = [(noise, Weighted(setup, self, noise))]
        return self._weighted[0][1]

    def with_residuals(self, path: FloatArray, steps: FloatArray, readings: FloatArray) -> Linear:
        """Return a copy with residuals at another path and these derivatives."""
        out = replace(self, path=path, step_residual=steps, reading_residual=readings, _weighted=[])
        out._weighted[:] = [(noise, problem.with_residuals(out)) for noise, problem in self._weighted]
        return out


def linear(
    setup: Setup,
    theta: Theta,
    path: FloatArray,
    driven: bool = True,
    near: Linear | None = None,
    inputs: Inputs | None = None,
) -> Linear:
    """Return residuals and derivatives at a path; those by the disturbances are left out unless `driven`.

    With `near` the derivatives are taken from there instead; the caller checks that they hold. `inputs` are
    those that the effects shift, where they are known.
    """
    drive, names = setup.drive, setup.states(theta)
    inputs = setup.inputs(theta) if inputs is None else inputs
    count, total = len(names), path.shape[1]
    dt = np.diff(drive.time_s)
    dt = np.where(drive.linked, dt, 1e-6)
    rolled = setup.baseline.evaluate_to_tyre_forces(path[:, :count], inputs, theta, names)
    rates, predicted, earlier = setup.evaluate(path, inputs, theta, names, rolled)
    ahead = predicted_steps(setup, theta, path, inputs, dt, rates.T[:-1])
    residual = np.where(drive.linked[:, None], path[1:] - ahead, 0.0)
    if near is not None:
        return near.with_residuals(path, residual, setup.readings() - predicted.T)
    chained = all(one.age_s.ndim == 0 for one in earlier.values())
    there = _Evaluated(path, inputs, names, rolled, rates, predicted)
    jacobian, outputs_by = _derivatives(setup, theta, there, total if driven else count, late=not chained)
    if chained:
        for name, derivatives in _delayed_by_state(setup, theta, there, earlier, jacobian, driven).items():
            outputs_by[:, setup.channels.index(name)] = derivatives
    by_state, by_rates = transition(setup, theta, inputs, jacobian, dt, count, driven)
    return Linear(path, residual, setup.readings() - predicted.T, by_state, outputs_by, by_rates)


@dataclass(frozen=True)
class _Evaluated:
    """Rates (s, n) and readings (m, n) at a path."""

    path: FloatArray
    inputs: Inputs
    states: tuple[str, ...]
    rolled: Rolled
    rates: FloatArray
    outputs: FloatArray


def _evaluate_without_ages(
    setup: Setup, theta: Theta, path: FloatArray, inputs: Inputs, states: tuple[str, ...]
) -> _Evaluated:
    """Return rates and readings, delays ignored."""
    rolled = setup.baseline.evaluate_to_tyre_forces(path[:, : len(states)], inputs, theta, states)
    rates, outputs, _ = setup.evaluate(path, inputs, theta, states, rolled, late=False)
    return _Evaluated(path, inputs, states, rolled, rates, outputs)


def _derivatives(
    setup: Setup, theta: Theta, at: _Evaluated, columns: int, late: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of rates (n, t, t) and readings (n, m, t) by so many columns of the path."""
    count, (rows, total) = len(at.states), at.path.shape
    jacobian, outputs_by = np.zeros((rows, total, total)), np.zeros((rows, len(setup.channels), total))
    for k in range(columns):
        moved = at.path.copy()
        moved[:, k] += _STEP
        known = at.rolled if k >= count else None
        up, out_up, _ = setup.evaluate(moved, at.inputs, theta, at.states, known, late)
        jacobian[:, :count, k] = ((up - at.rates) / _STEP).T
        outputs_by[:, :, k] = ((out_up - at.outputs) / _STEP).T
    return jacobian, outputs_by


def _delayed_by_state(
    setup: Setup,
    theta: Theta,
    now: _Evaluated,
    earlier: Mapping[str, Earlier],
    jacobian: FloatArray,
    driven: bool,
) -> dict[str, FloatArray]:
    """Return the derivatives of delayed readings by the path, (n, t) by the output's name.

    By the chain rule: those by the earlier state times those of the earlier state by the path, the
    exponential of the mean Jacobian as for a step, from one earlier state to the next. `jacobian` is that of
    now.
    """
    disturbances = now.path[:, len(now.states) :]
    total, pushes = now.path.shape[1], disturbances.shape[1]
    out: dict[str, FloatArray] = {}
    at, before, age, by_path = now, jacobian, 0.0, _state_selector(now)
    for name, one in earlier.items():
        if float(one.age_s) * age < 0.0:
            at, before, age, by_path = now, jacobian, 0.0, _state_selector(now)
        kept = [k for k, state in enumerate(at.states) if state in one.state]
        count = len(kept)
        width = count + (pushes if driven else 0)
        if count < len(at.states):
            columns = [*kept, *range(len(at.states), at.path.shape[1])]
            names = tuple(at.states[k] for k in kept)
            at, by_path = (
                _evaluate_without_ages(setup, theta, at.path[:, columns], at.inputs, names),
                by_path[kept],
            )
            before = _derivatives(setup, theta, at, width, late=False)[0]
        path = np.column_stack([*(one.state[state] for state in at.states), disturbances])
        at = _evaluate_without_ages(setup, theta, path, one.frame.inputs, at.states)
        there, outputs_by = _derivatives(setup, theta, at, width, late=False)
        span = float(one.age_s) - age
        acting = [effect for effect in theta if set(effect.states) <= set(at.states)]
        substeps = setup.baseline.substeps(now.inputs, abs(span), acting)
        mean = np.moveaxis(0.5 * (before[:, :count] + there[:, :count]), 0, -1) * (-span / substeps)
        step, push, _ = _exponential(mean, substeps)
        by_path = _matrix_products(step, by_path)
        by_path[:, total - pushes :] += push
        if name in setup.channels:
            by = outputs_by[:, setup.channels.index(name)].T
            whole = _matrix_products(by[None, :count], by_path)[0]
            whole[total - pushes :] += by[count:]
            out[name] = whole.T
        before, age = there, float(one.age_s)
    return out


def _state_selector(at: _Evaluated) -> FloatArray:
    """Return the derivatives of states by the path, (s, t, n): ones where they are the same."""
    rows, total = at.path.shape
    return _add_identity(np.zeros((len(at.states), total, rows)))


def transition(
    setup: Setup, theta: Theta, inputs: Inputs, jacobian: FloatArray, dt: FloatArray, count: int, driven: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of the steps, (n - 1, t, t): the exponential of the mean Jacobian; and those by
    rates at their starts and ends, (2, n - 1, s, s), empty unless `driven`."""
    substeps = setup.baseline.substeps(inputs, float(np.median(dt)), theta)
    mean = np.moveaxis(0.5 * (jacobian[:-1, :count] + jacobian[1:, :count]), 0, -1) * (dt / substeps)
    by_own, by_driven, by_rates = _exponential(mean, substeps, driven)
    by_rates = np.moveaxis(by_rates * np.where(setup.drive.linked, dt / substeps, 0.0), -1, 1)
    out = np.zeros((len(dt), len(jacobian[0]), len(jacobian[0])))
    out[:, :count, :count] = np.moveaxis(by_own, -1, 0)
    out[:, :count, count:] = np.moveaxis(by_driven, -1, 0)
    for k in range(count, out.shape[1]):
        out[:, k, k] = np.exp(-dt / SETTINGS.disturbance_time_s)
    return out, np.ascontiguousarray(by_rates)


def _exponential(
    mean: FloatArray, substeps: int, by_rates: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the derivatives of so many steps by states (s, s, n) and by disturbances (s, d, n), and of one
    time unit's by rates at the start and at the end, (2, s, s, n), empty unless `by_rates`.

    `mean` is the Jacobian times one of them, (s, t, n), which is the time unit.
    """
    count = len(mean)
    own, driven = np.ascontiguousarray(mean[:, :count]), np.ascontiguousarray(mean[:, count:])
    # exp [A B; 0 0] = [exp A, P B; 0 1] with P = 1 + A / 2 + A^2 / 6 + A^3 / 24 and exp A = 1 + A P
    # a rate that rises to 1 over the step gives the integral of P's: 1 / 2 + A / 6 + A^2 / 24
    rising = 0.5 * _add_identity(_matrix_products(own, _add_identity(own / 4.0)) / 3.0)
    series = _add_identity(_matrix_products(own, rising))
    by_own, by_driven = _add_identity(_matrix_products(own, series)), _matrix_products(series, driven)
    for _ in range(int(np.log2(substeps))):
        if by_rates:
            rising = 0.5 * (_matrix_products(by_own, rising) + rising + series)
            series = _matrix_products(by_own, series) + series
        by_own, by_driven = _matrix_products(by_own, by_own), _matrix_products(by_own, by_driven) + by_driven
    return by_own, by_driven, np.stack([series - rising, rising]) if by_rates else np.zeros((2, 0, 0, 1))


def _add_identity(matrix: FloatArray) -> FloatArray:
    """Add one to the diagonals of matrices (s, s, n), in place; return them."""
    for k in range(len(matrix)):
        matrix[k, k] += 1.0
    return matrix


def _matrix_products(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return products of small matrices (i, k, n) and (k, j, n), over time at once."""
    out = np.empty((left.shape[0], right.shape[1], left.shape[2]))
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = left[i, 0] * right[0, j]
            for k in range(1, left.shape[1]):
                out[i, j] += left[i, k] * right[k, j]
    return out


def predicted_steps(
    setup: Setup, theta: Theta, path: FloatArray, inputs: Inputs, dt: FloatArray, rates: FloatArray
) -> FloatArray:
    """Return the path predicted one step ahead of each row, (n - 1, t); `rates` are those at its start."""
    state, free = setup.split_path(path[:-1], len(setup.states(theta)))
    span = Span(inputs.take(slice(0, -1)), inputs.take(slice(1, None)))
    ahead = setup.baseline.step(state, span, (*theta, free), dt, rates)
    decay = np.exp(-dt / SETTINGS.disturbance_time_s)[:, None]
    return np.concatenate([ahead, path[:-1, state.shape[1] :] * decay], axis=1)


class Weighted:
    """A linear problem with noise: its factor over the path, ready for any right-hand sides."""

    def __init__(self, setup: Setup, at: Linear, noise: PathNoise) -> None:
        drive = setup.drive
        dt = np.diff(drive.time_s)
        step = np.where(drive.linked[:, None], 1.0 / noise.step_variance(dt), 0.0)
        known = np.isfinite(at.reading_residual)
        reading = np.where(known, 1.0 / noise.outputs**2, 0.0)
        self.step_weight, self.reading_weight = step, reading
        self.at = replace(at, _weighted=[])  # a cycle of references would keep both
        diagonal = np.einsum(
            "nmi,nm,nmj->nij", at.outputs_by_state, reading, at.outputs_by_state, optimize=True
        )
        weighted = step[:, :, None] * at.by_state
        diagonal[:-1] += np.swapaxes(at.by_state, 1, 2) @ weighted
        order = np.arange(diagonal.shape[1])
        diagonal[1:, order, order] += step
        first = 1.0 / np.concatenate([noise.start, noise.disturbance]) ** 2
        diagonal[drive.starts[:, None], order, order] += first
        self._starts, self._start_weight = drive.starts, first
        self._start_pull = np.where(order < len(noise.white), 0.0, first)
        self.factor = BandedFactor(diagonal, -weighted)

    def with_residuals(self, at: Linear) -> Weighted:
        """Return a copy with other residuals and the same derivatives."""
        out = copy(self)
        out.at = replace(at, _weighted=[])
        return out

    def gradient(self) -> FloatArray:
        """Return the right-hand side of the normal equations of the path, (n, t)."""
        out = self._right_hand_side(self.at.step_residual, self.at.reading_residual)
        out[self._starts] -= self.at.path[self._starts] * self._start_pull
        return out

    def _right_hand_side(self, steps: FloatArray, readings: FloatArray) -> FloatArray:
        """Return the right-hand side by residuals of steps and readings, (n, t)."""
        at = self.at
        out = np.einsum("nmi,nm->ni", at.outputs_by_state, self.reading_weight * _nan_to_zero(readings))
        pull = self.step_weight * steps
        out[1:] -= pull
        out[:-1] += np.einsum("nij,ni->nj", at.by_state, pull)
        return np.asarray(out)

    def residual_squares(self) -> FloatArray:
        """Return the sums of squares, over variances, of the residuals that the path's own step leaves: of
        each state's steps, then of each output's readings."""
        return self._squares(self.at.step_residual, self.at.reading_residual, self.gradient())

    def expected_squares(self) -> FloatArray:
        """Return the `residual_squares` of residuals drawn from this noise, each one standard deviation."""
        steps = unit_residuals(self.step_weight)
        readings = np.where(self.reading_weight > 0.0, unit_residuals(self.reading_weight), np.nan)
        asked = self._right_hand_side(steps, readings)
        starts = np.broadcast_to(self._start_weight, (len(self._starts), asked.shape[1]))
        asked[self._starts] -= unit_residuals(starts) * starts
        return self._squares(steps, readings, asked)

    def _squares(self, steps: FloatArray, readings: FloatArray, asked: FloatArray) -> FloatArray:
        """Return the sums of weighted squares of the residuals after the path's step by `asked`."""
        move = self.factor.solve(asked)
        left = steps + move[1:] - np.einsum("nij,nj->ni", self.at.by_state, move[:-1])
        unread = _nan_to_zero(readings - np.einsum("nmi,ni->nm", self.at.outputs_by_state, move))
        return np.concatenate(
            [(self.step_weight * left**2).sum(axis=0), (self.reading_weight * unread**2).sum(axis=0)]
        )


def _nan_to_zero(residual: FloatArray) -> FloatArray:
    """Return residuals with 0 in place of NaN."""
    return np.where(np.isfinite(residual), residual, 0.0)


def smoothed(setup: Setup, theta: Theta, start: FloatArray | Linear, noise: PathNoise) -> Linear:
    """Return the likeliest path, with residuals and derivatives there, by damped Gauss-Newton.

    `start` is a path, or what is known at one for the same effects. Derivatives are kept where a step
    decreases the sum of squares as they predict.
    """
    kept = isinstance(start, Linear)
    at = start if isinstance(start, Linear) else linear(setup, theta, start)
    cost = path_cost(setup, at, noise)
    for _ in range(SETTINGS.path_rounds):
        step = at.weighted(setup, noise)
        gradient = step.gradient()
        move = step.factor.solve(gradient)
        fall = float(np.vdot(gradient, move))
        if fall < SETTINGS.path_tolerance * max(1.0, 1e-4 * cost):
            break
        for share in (1.0, 0.3, 0.1, 0.03):
            tried = linear(setup, theta, at.path + share * move, near=at)
            new = path_cost(setup, tried, noise)
            if np.isfinite(new) and new <= cost * (1.0 + 1e-9) + 1e-6:
                break
        else:
            if not kept:
                return at
            at, kept = linear(setup, theta, at.path), False
            continue
        tolerance = SETTINGS.path_tolerance * max(1.0, 1e-4 * new)
        done = cost - new < tolerance
        apart = abs(cost - new - (2.0 - share) * share * fall)
        kept = apart < max(tolerance, SETTINGS.derivative_error * fall)
        at, cost = tried if kept else linear(setup, theta, tried.path), new
        if done:
            break
    return at


def path_cost(setup: Setup, at: Linear, noise: PathNoise) -> float:
    """Return the sum of squares over variances of steps, readings and starts."""
    dt = np.diff(setup.drive.time_s)
    steps = np.where(setup.drive.linked[:, None], at.step_residual**2 / noise.step_variance(dt), 0.0)
    starts = at.path[setup.drive.starts, len(noise.white) :] ** 2 / noise.disturbance**2
    return float(steps.sum() + np.nansum(at.reading_residual**2 / noise.outputs**2) + starts.sum())


def path_log_likelihood(setup: Setup, at: Linear, noise: PathNoise, rest: Theta | None = None) -> float:
    """Return the log-likelihood of the likeliest path, up to what all models of the drive share.

    With `rest`, the effects with every body that swings at rest, all paths are integrated by Laplace's
    method: a model whose readings follow sudden forces more has likelier paths and fewer of them. Models
    without such a body differ too little in it.
    """
    likelihood = -0.5 * path_cost(setup, at, noise)
    if rest is None:
        return likelihood
    volumes = [
        one.weighted(setup, noise).factor.half_log_determinant() for one in (at, linear(setup, rest, at.path))
    ]
    return likelihood - volumes[0] + volumes[1]


def fitted_noise(setup: Setup, at: Linear, noise: PathNoise, rounds: int, least: PathNoise) -> PathNoise:
    """Return the noise under which the residuals are as large as they are expected to be.

    MacKay's fixed point: each variance is its sum of squares over the one that is expected of it; that comes
    from residuals drawn with this noise and smoothed as the real ones are. Few rows are enough. Steps of the
    iteration that keep their direction grow, so that a variance near 0 gets there.
    """
    few, part = subset_of_blocks(setup, at)
    power: FloatArray | float = 1.0
    last: FloatArray | float = 0.0
    for _ in range(rounds):
        weighted = part.weighted(few, noise)
        ratio = (weighted.residual_squares() + 1e-12) / (weighted.expected_squares() + 1e-12)
        move = np.log(np.clip(ratio, 0.05, 20.0))
        faster = np.minimum(power * SETTINGS.noise_faster, SETTINGS.noise_max_power)
        power = np.where(move * last > 0.0, faster, 1.0)
        noise = _scaled_noise(noise, np.exp(0.5 * np.clip(power * move, -3.0, 3.0)), least)
        last = move
    return noise


def _scaled_noise(noise: PathNoise, by: FloatArray, least: PathNoise) -> PathNoise:
    """Return the noise, its variances' roots times these factors, none below `least`."""
    states, free = len(noise.white), len(noise.disturbance)
    return replace(
        noise,
        white=np.maximum(noise.white * by[:states], least.white),
        disturbance=np.maximum(noise.disturbance * by[states : states + free], least.disturbance),
        outputs=np.maximum(noise.outputs * by[states + free :], least.outputs),
    )


def unit_residuals(weight: FloatArray) -> FloatArray:
    """Return residuals of plus or minus one standard deviation; 0 where the weight is 0."""
    scale = np.where(weight > 0.0, 1.0 / np.sqrt(np.where(weight > 0.0, weight, 1.0)), 0.0)
    return pseudo_random_signs(weight.size).reshape(weight.shape) * scale


def pseudo_random_signs(count: int) -> FloatArray:
    """Return a fixed pseudo-random sequence of -1 and 1.

    The finaliser of SplitMix64 on a counter; products of such signs estimate traces (Hutchinson's method).
    """
    word = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        word = (word ^ (word >> np.uint64(shift))) * np.uint64(factor)
    word ^= word >> np.uint64(31)
    return np.where(word & np.uint64(1), 1.0, -1.0)


def subset_of_blocks(setup: Setup, at: Linear, besides: BoolArray | None = None) -> tuple[Setup, Linear]:
    """Return setup and linear problem on every k-th block, for enough rows, and on those `besides`, (B,)."""
    drive = setup.drive
    n = len(drive.time_s)
    taken = np.zeros(len(drive.starts), dtype=bool) if besides is None else besides.copy()
    taken[part_of_blocks(setup)] = True
    if taken.all():
        return setup, at
    few, rows = drive_of_blocks(drive, taken)
    links = rows[:-1]
    part = Linear(
        at.path[rows],
        at.step_residual[np.minimum(links, n - 2)],
        at.reading_residual[rows],
        at.by_state[np.minimum(links, n - 2)],
        at.outputs_by_state[rows],
        at.by_rates[:, np.minimum(links, n - 2)],
    )
    return replace(setup, drive=few), part


def drive_of_blocks(drive: DynamicsDrive, taken: BoolArray) -> tuple[DynamicsDrive, IntArray]:
    """Return a drive of some of the blocks, (B,), and their rows; the drive itself where all are taken."""
    if taken.all():
        return drive, np.arange(len(drive.time_s))
    blocks = list(zip(drive.starts[taken], drive.ends[taken], strict=True))
    rows = np.concatenate([np.arange(first, last) for first, last in blocks])
    outputs = {name: values[rows] for name, values in drive.outputs.items()}
    few = _Part(drive.name, drive.inputs.take(rows), outputs, drive.forces, drive.start_s)
    begins = np.cumsum([0, *(last - first for first, last in blocks)])
    few.__dict__["starts"], few.__dict__["ends"] = begins[:-1], begins[1:]
    few.__dict__["moving"] = drive.moving[rows]
    return few, rows


def part_of_blocks(setup: Setup) -> slice:
    """Return a slice of every k-th block with enough rows in all; all blocks of a short drive."""
    every = max(len(setup.drive.time_s) // SETTINGS.noise_rows, 1)
    return slice(None) if every == 1 else slice(every // 2, None, every)


class _Part(DynamicsDrive):
    """Blocks of a drive, their borders as in the whole."""
