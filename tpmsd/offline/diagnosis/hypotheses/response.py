"""Linearised responses of the channels to every hypothesis.

In: a `Reader` and a model to linearise about. Out: `Columns`: one column (w, 9) per free number: the
calibration's radii, each parameter of each effect of the catalogue, ramps of each wheel's radius between
knots, and spline terms over each covariate. The catalogue's columns are differences of its
own forward model, so an effect is defined once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS, FAULT, RADIUS, FittedParameter, make_effect, probes
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import IS_FRONT, WHEELS, FloatArray
from tpmsd.offline.diagnosis.hypotheses.wheel_slip import slip_columns
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.covariate_errors import expected
from tpmsd.offline.inference.stack import ColumnStack
from tpmsd.offline.inference.trajectory import WINDOW_S
from tpmsd.offline.inference.windows import CHANNELS, COURSE, EAST, GYRO, SPEED, Reader

ROLLING = ExtendedModel()
READINGS = {"gnss_speed": SPEED, "gnss_course": COURSE, "yaw_rate": GYRO}
SINGLE_PATTERNS = ("fl", "fr", "rl", "rr", *READINGS)
"""Channels and wheel patterns on which a smooth term may act."""


class Columns:
    """Named columns, all of shape (w, 9)."""

    def __init__(self) -> None:
        self.names: list[tuple[str, ...]] = []
        self.stack = ColumnStack()

    def add(self, name: tuple[str, ...], array: FloatArray) -> None:
        """Append one (w, 9); what is not finite (not measured) counts as no response."""
        self.names.append(name)
        self.stack.add(_finite(array))

    def add_of_channel(self, names: Sequence[tuple[str, ...]], channel: int, values: FloatArray) -> None:
        """Append several that are zero but in one channel: their values (w, k) there."""
        self.names += names
        self.stack.add_of_channel(channel, _finite(values))

    def extend(self, other: Columns) -> None:
        """Append those of another."""
        self.names += other.names
        self.stack += other.stack

    @property
    def arrays(self) -> list[FloatArray]:
        """Return each column (w, 9)."""
        return [self.stack[k] for k in range(len(self.names))]

    def index(self) -> dict[tuple[str, ...], int]:
        """Return the position of each column by its name."""
        return {name: k for k, name in enumerate(self.names)}


def _finite(array: FloatArray) -> FloatArray:
    return array if np.isfinite(array).all() else np.nan_to_num(array)


def linear_columns(
    reader: Reader,
    knots: dict[str, FloatArray],
    stds: Mapping[str, float],
    base: ExtendedModel | None = None,
) -> Columns:
    """Return the columns of calibration, catalogue at `base`, ramps, smooth terms on these knots over
    covariates with these errors, and slips by the tyre model."""
    out = Columns()
    for part in (
        calibration_columns(reader),
        catalogue_columns(reader, base),
        ramp_columns(reader),
        smooth_columns(reader, knots, stds),
    ):
        out.extend(part)
    for name, column in slip_columns(reader):
        out.add(name, column)
    return out


def available_readings(reader: Reader) -> frozenset[str]:
    """Return the names of the readings that a drive has, as effects list them in their needs."""
    known = np.isfinite(reader.windows.measured).sum(axis=0)
    by = reader.reference.grade_by
    here = {
        "yaw_rate": known[GYRO] > SETTINGS.hypotheses.fewest_readings,
        "gnss": bool((known[SPEED:] > SETTINGS.hypotheses.fewest_readings).any()),
        "gnss_speed": known[SPEED] > 2 * SETTINGS.hypotheses.fewest_readings,
        "gnss_position": known[EAST] > 2 * SETTINGS.hypotheses.fewest_readings,
        "slopes": reader.reference.grade_known,
        "heights": by == "heights",
        "accelerometer": by == "accelerometer",
        "speeds": bool((reader.recording.quantum_rad == 0.0).all()),
        "temperature": "temperature" in reader.windows.covariates,
        "torque": "torque" in reader.windows.covariates,
        "both_axles": len({bool(IS_FRONT[wheel]) for wheel in reader.recording.wheels}) == 2,
    }
    return frozenset(name for name, there in here.items() if there)


def calibration_columns(reader: Reader) -> Columns:
    """Return the columns that are always fitted: a radius for each wheel that is read, and the instruments'
    constants."""
    out = Columns()
    for wheel in reader.recording.wheels:
        out.add((RADIUS.name, WHEELS[wheel]), _radius_response(reader, wheel))
    here = available_readings(reader)
    for probe in probes():
        effect = EFFECTS[probe.effect]
        if (
            effect.identification.always_fitted
            and effect is not RADIUS
            and here >= set(effect.identification.needs)
        ):
            out.add(probe.key, reader.change(ROLLING, probe.probing_effect()) / (probe.value - probe.neutral))
    return out


def catalogue_columns(
    reader: Reader, base: ExtendedModel | None = None, only: frozenset[str] | None = None
) -> Columns:
    """Return one column per probe of the catalogue (of `only` these effects) that the drive can show, at
    `base`.
    """
    base = ROLLING if base is None else base
    here = available_readings(reader)
    out = Columns()
    for probe in probes():
        effect = EFFECTS[probe.effect]
        if only is not None and probe.effect not in only:
            continue
        if not effect.identification.always_fitted and here >= set(effect.identification.needs):
            out.add(probe.key, _unit_response(reader, probe, base))
    return out


def _unit_response(reader: Reader, probe: FittedParameter, base: ExtendedModel) -> FloatArray:
    """Return the (w, 9) response to a unit of a parameter: from neutral where the effect is not in the model,
    else the tangent at the value that it has there (the response of a low-pass of 1 s is not a multiple of
    that of 0.1 s)."""
    there = next((one for one in base if one.name == probe.effect), None)
    if there is None or not probe.parameter or probe.wheel_pattern or probe.at is not None:
        return reader.change(base, probe.probing_effect()) / (probe.value - probe.neutral)
    value = float(getattr(there, probe.parameter))
    step = SETTINGS.hypotheses.tangent_share * (value - probe.neutral) or probe.value - probe.neutral
    moved = replace(there, **{probe.parameter: value + step})
    model = ExtendedModel(tuple(moved if one is there else one for one in base))
    return np.asarray((reader.predict(model) - reader.predicted(base)) / step)


def grid_column(
    reader: Reader,
    wanted: tuple[str, str, str],
    at: tuple[float, float | None],
    base: ExtendedModel | None = None,
) -> FloatArray:
    """(w, 9) response to an effect's linear parameter on a wheel pattern (`wanted`) where its nonlinear ones
    have these values, at `base`."""
    like = next(p for p in probes() if (p.effect, p.parameter, p.wheel_pattern) == wanted)
    probe = replace(like, at=at[0], second=at[1])
    change = reader.change(ROLLING if base is None else base, probe.probing_effect())
    return np.asarray(change / (probe.value - probe.neutral))


def ramp_column(
    reader: Reader,
    wheel: int,
    span: tuple[float, float],
    base: ExtendedModel | None = None,
    course: str = "",
) -> FloatArray:
    """(w, 9) response to a radius that ramps by a metre, at `base`; `span` is onset and duration, s."""
    unit = make_effect(
        FAULT.name,
        wheel=WHEELS[wheel],
        deviation_m=SETTINGS.hypotheses.probe_m,
        onset_s=span[0],
        duration_s=span[1],
        course=course or FAULT.nonlinear.courses[0],
    )
    motion, car = reader.reference.motion, reader.reference.car
    share = unit.radius_change_m(motion, car)[:, wheel] / SETTINGS.hypotheses.probe_m
    out = np.zeros((len(reader.windows), CHANNELS))
    out[:, wheel] = reader.by_radius(wheel, share, ROLLING if base is None else base)
    return out


def ramp_knots(reader: Reader) -> FloatArray:
    """(`ramp_knots` + 1,) knots of the radius ramps: equal shares of the driving, as times."""
    index = reader.windows.index
    at = np.linspace(0, len(index) - 1, SETTINGS.hypotheses.ramp_knots + 1)
    return np.asarray(np.interp(at, np.arange(len(index)), index * WINDOW_S))


def ramp_columns(reader: Reader) -> Columns:
    """Return the columns of ramps: a radius that rises by a metre between two neighbouring knots and stays.

    Sums of neighbours are the ramps over longer times.
    """
    out = Columns()
    knots = ramp_knots(reader)
    since_s = reader.windows.time_s[:, None] - knots[:-1]
    shares = np.clip(since_s / np.maximum(np.diff(knots), 1e-9), 0.0, 1.0)
    for wheel in reader.recording.wheels:
        per_metre = _radius_response(reader, wheel)[:, wheel]
        names = [("ramp", WHEELS[wheel], str(k)) for k in range(SETTINGS.hypotheses.ramp_knots)]
        out.add_of_channel(names, wheel, per_metre[:, None] * shares)
    return out


def smooth_knots(
    covariates: Mapping[str, FloatArray], stds: Mapping[str, float] = MappingProxyType({})
) -> dict[str, FloatArray]:
    """Return the knots by covariate at quantiles of its values, where it varies; the first and last are 1 %
    and 99 %.

    No two are nearer than four of the covariate's standard deviations `stds`.
    """
    out: dict[str, FloatArray] = {}
    for covariate, values in covariates.items():
        if covariate == "accel_kinematic":
            continue  # the specific force stands for it
        terms = (
            SETTINGS.hypotheses.time_intervals
            if covariate in ("time", "distance")
            else SETTINGS.hypotheses.spline_intervals
        )
        at = np.unique(np.quantile(values, np.linspace(0.01, 0.99, terms + 1)))
        at = _thinned_knots(at, SETTINGS.hypotheses.apart_stds * stds.get(covariate, 0.0))
        if len(at) >= 3 and np.ptp(at) >= 1e-9:
            out[covariate] = at
    return out


def _thinned_knots(knots: FloatArray, least: float) -> FloatArray:
    """Return the knots thinned to a minimum spacing; the first and the last stay."""
    kept = [float(knots[0])]
    for knot in knots[1:-1]:
        if knot - kept[-1] >= least and knots[-1] - knot >= least:
            kept.append(float(knot))
    return np.array([*kept, float(knots[-1])]) if knots[-1] - knots[0] >= least else knots[:1]


def smooth_columns(
    reader: Reader, knots: dict[str, FloatArray], stds: Mapping[str, float] = MappingProxyType({})
) -> Columns:
    """Return the columns of spline terms: hat functions of each covariate on each wheel or reading.

    A wheel's term is a change of its radius (m), the receiver's of its speed (m/s) or course (rad), the
    gyro's of its reading (rad/s).
    """
    out = Columns()
    patterns = [WHEELS[wheel] for wheel in reader.recording.wheels]
    for pattern, channel in READINGS.items():
        if np.isfinite(reader.windows.measured[:, channel]).sum() > 60:
            patterns.append(pattern)
    responses = {pattern: response_at(reader, pattern) for pattern in patterns}
    for covariate, at in knots.items():
        hats = hat_functions(expected(reader.windows.covariates[covariate], stds.get(covariate, 0.0)), at)
        for pattern, response in responses.items():
            channel = channel_of(pattern)
            mine = hats[:, first_hat(pattern) :]
            names = [("smooth", pattern, covariate, str(k)) for k in range(mine.shape[1])]
            out.add_of_channel(names, channel, response[:, channel, None] * mine)
    return out


def channel_of(pattern: str) -> int:
    """Return the channel of a wheel or a reading."""
    return WHEELS.index(pattern) if pattern in WHEELS else READINGS[pattern]


def first_hat(pattern: str) -> int:
    """Return the number of the first hat that a spline term on a wheel or reading needs.

    All hats together are a constant. Calibration holds that of a wheel, so its first is left out. A reading
    has none: without its own, a spline of the gyro would need a bias fitted jointly.
    """
    return 0 if pattern in READINGS else 1


def response_at(reader: Reader, pattern: str) -> FloatArray:
    """Return the (w, 9) response to a metre of a wheel's radius, or to a unit of a reading (m/s, rad,
    rad/s)."""
    if pattern in WHEELS:
        return _radius_response(reader, WHEELS.index(pattern))
    out = np.zeros((len(reader.windows), CHANNELS))
    out[:, READINGS[pattern]] = 1.0
    return out


def finer_knots(values: FloatArray, intervals: int, std: float = 0.0) -> FloatArray:
    """(at most intervals + 1,) knots between the 0.2 % and 99.8 % quantiles, half by quantile, half evenly,
    none nearer to another than four standard deviations of the covariate.

    By quantiles alone the tails, where the effects are largest, would have none.
    """
    share = np.linspace(0.002, 0.998, intervals + 1)
    low, high = np.quantile(values, [share[0], share[-1]])
    knots = np.unique(0.5 * (np.quantile(values, share) + np.linspace(low, high, intervals + 1)))
    kept = [float(knots[0])]
    for knot in knots[1:]:
        here = np.count_nonzero((values > kept[-1]) & (values <= knot))
        least = max(SETTINGS.hypotheses.apart_stds * std, 1e-6 * max(float(high - low), 1e-12))
        if here >= SETTINGS.hypotheses.fewest_between_knots and knot - kept[-1] > least:
            kept.append(float(knot))
    return np.array(kept)


def hat_functions(values: FloatArray, knots: FloatArray) -> FloatArray:
    """(n, len(knots)) piecewise linear interpolation weights; constant beyond the ends."""
    at = np.interp(values, knots, np.arange(len(knots)))
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] - np.arange(len(knots))[None, :]))


def _radius_response(reader: Reader, wheel: int) -> FloatArray:
    """(w, 9) response to a metre more radius: the wheel turns less.

    By the predicted distance: the measured one shares its reading errors with the residual, and with
    thousands of windows that product adds up to a radius that grows with speed.
    """
    out = np.zeros((len(reader.windows), CHANNELS))
    out[:, wheel] = -reader.rolled_m[:, wheel] / reader.reference.car.radius_m[wheel]
    return out
