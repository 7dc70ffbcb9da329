"""Findings over a fleet: effects of a model, cars that differ from it, tyres that leak or wear.

In: the fits of the models, the times of the drives. Out: `FleetHypothesis`s with p-values, those kept by
Benjamini and Hochberg (J. R. Stat. Soc. B 57, 1995) over all that were tested. Pure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.fleet.hierarchy import (
    FleetStatistics,
    ModelFit,
    fit_with,
    integrate_out_random_effect,
    sample_cars,
    variance_components,
)
from tpmsd.offline.fleet.parameters import PARAMETERS_OF_FLEET, RADII_OF_CONTRASTS, SCALES
from tpmsd.offline.fleet.settings import SETTINGS, FleetSettings

DAYS_PER_WEEK = 7.0


@dataclass(frozen=True, slots=True)
class FleetHypothesis:
    """A tested statement about a model or a car: `value`, its `std`, the p-value, and if it is kept."""

    level: str
    """model | car"""
    model: str
    car: str
    """Empty for a model."""
    kind: str
    """effect: acts on the model. differs: this car is unlike its model. leak, wear: a trend of this car.
    loss: a radius that is smaller from one of its drives on."""
    effect: str
    parameter: str
    value: float
    """In `unit`; of a car that differs, its difference to the model."""
    std: float
    unit: str
    p_value: float
    kept: bool = False
    since_s: float | None = None
    """Host time from which on, where there is a moment (s)."""


def model_effects(model: str, fit: ModelFit) -> list[FleetHypothesis]:
    """Test every parameter's population mean against zero, the value of the baseline model."""
    found = []
    for k, parameter in enumerate(PARAMETERS_OF_FLEET):
        if not parameter.null or fit.std[k] > SETTINGS.well_known_scales:
            continue
        p_value = 2.0 * float(stats.t.sf(abs(fit.mean[k] / fit.std[k]), fit.freedom[k]))
        found.append(_parameter_hypothesis("model", model, "", "effect", k, fit.mean[k], fit.std[k], p_value))
    return found


def robust_fit(stack: FleetStatistics) -> tuple[ModelFit, NDArray[np.bool_]]:
    """Return the fit of a model to the cars that are alike, and (m,) True for those cars.

    Cars that differ at `outlier_p` are taken out of mean and spread, and judged again in the next round.
    """
    similar = np.ones(stack.cars, dtype=np.bool_)
    for _ in range(SETTINGS.outlier_rounds):
        cars, drives = variance_components(sample_cars(stack.of_cars(similar)))
        fit = _fit_with_similar_population(stack, similar, cars, drives)
        p_values = differences_from_other_cars(fit, similar)[2]
        level = SETTINGS.outlier_p / max(p_values.shape[1], 1)
        now = ~np.any(p_values < level, axis=1)
        if now.sum() < max(2, stack.cars // 2) or np.array_equal(now, similar):
            break
        similar = now
    return fit, similar


def _fit_with_similar_population(
    stack: FleetStatistics, similar: NDArray[np.bool_], cars: FloatArray, drives: FloatArray
) -> ModelFit:
    """Return the fit of all cars, shrunk to the population of those that are alike."""
    whole = fit_with(stack, cars, drives)
    if similar.all():
        return whole
    population = fit_with(stack.of_cars(similar), cars, drives)
    names = ("mean", "covariance", "freedom")
    return replace(whole, **{name: getattr(population, name) for name in names})


def differences_from_other_cars(
    fit: ModelFit, similar: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return, (m, p) each, the car's own value less the other cars' mean, its standard deviation, and its
    p-value.

    The mean is taken without the car itself: with weights 1/(spread^2 + std^2), parameter by parameter.
    """
    own_variance = np.einsum("cii->ci", fit.own_covariance)
    variance = own_variance + np.square(fit.car_spread)
    weight = np.where(similar[:, None], 1.0 / variance, 0.0)
    others = weight.sum(axis=0) - weight
    mean = ((weight * fit.own).sum(axis=0) - weight * fit.own) / np.maximum(others, SETTINGS.ridge)
    std = np.sqrt(variance + 1.0 / np.maximum(others, SETTINGS.ridge))
    counted = np.maximum(similar.sum() - 1.0 - similar, 1.0)[:, None]
    p_values = 2.0 * stats.t.sf(np.abs(fit.own - mean) / std, counted)
    known = (np.sqrt(own_variance) < SETTINGS.well_known_scales) & (fit.drives > 0)[:, None]
    return fit.own - mean, std, np.where(known, p_values, 1.0)


def cars_that_differ(
    model: str, cars: Sequence[str], fit: ModelFit, similar: NDArray[np.bool_]
) -> list[FleetHypothesis]:
    """Test each parameter of each car against the other cars of its model."""
    if len(cars) < 3:
        return []
    value, std, p_value = differences_from_other_cars(fit, similar)
    return [
        _parameter_hypothesis("car", model, car, "differs", k, value[c, k], std[c, k], float(p_value[c, k]))
        for c, car in enumerate(cars)
        for k in range(len(PARAMETERS_OF_FLEET))
        if p_value[c, k] < 1.0
    ]


def radius_trends(
    model: str,
    cars: Sequence[str],
    stack: FleetStatistics,
    days: FloatArray,
    drive_variance: FloatArray,
    settings: FleetSettings = SETTINGS,
) -> list[FleetHypothesis]:
    """Test the slopes of radii over the days (n,): each wheel against the other of its axle, and all
    together.

    Generalised least squares with a line per radius and constants for all else; drives differ by
    `drive_variance`. One-sided: tyres leak and wear, they do not grow.
    """
    found: list[FleetHypothesis] = []
    K, k = integrate_out_random_effect(stack.information, stack.vector, drive_variance)
    p = k.shape[1]
    for car, mine in zip(cars, stack.car_slices(), strict=True):
        t = days[mine]
        known = np.isfinite(t)
        if known.sum() < settings.min_drives_trend or np.ptp(t[known]) < settings.min_span_days:
            continue
        t = np.where(known, t - t[known].mean(), 0.0)
        Kc, kc = K[mine][known], k[mine][known]
        t = t[known]
        cross = np.einsum("d,dij->ij", t, Kc)[:, :4]
        slopes = np.einsum("d,dij->ij", t * t, Kc)[:4, :4]
        total = np.block([[Kc.sum(axis=0), cross], [cross.T, slopes]]) + SETTINGS.ridge * np.eye(p + 4)
        right = np.concatenate([kc.sum(axis=0), (t @ kc)[:4]])
        covariance = np.asarray(np.linalg.inv(total), dtype=np.float64)
        slope, of_slope = (covariance @ right)[p:], covariance[p:, p:]
        freedom = max(len(t) - 2, 1)
        for wheel in range(4):
            axle = RADII_OF_CONTRASTS[wheel] - RADII_OF_CONTRASTS[wheel ^ 1]
            found.append(_trend_hypothesis(model, car, "leak", WHEELS[wheel], axle, slope, of_slope, freedom))
        common = np.array([1.0, 0.0, 0.0, 0.0])
        found.append(_trend_hypothesis(model, car, "wear", "all", common, slope, of_slope, freedom))
    return found


def _trend_hypothesis(
    model: str,
    car: str,
    kind: str,
    wheel: str,
    contrast: FloatArray,
    slope: FloatArray,
    covariance: FloatArray,
    freedom: int,
) -> FleetHypothesis:
    """Return the hypothesis on the slope of one contrast of radii, % a week; one-sided, for a falling
    radius.
    """
    row = contrast * SCALES[:4]
    per_week = 100.0 * DAYS_PER_WEEK
    value, std = float(row @ slope) * per_week, float(np.sqrt(row @ covariance @ row)) * per_week
    p_value = float(special.stdtr(freedom, value / std))
    effect = "slow_leak" if kind == "leak" else "wear"
    return FleetHypothesis("car", model, car, kind, effect, wheel, value, std, "%/week", p_value)


def _parameter_hypothesis(
    level: str, model: str, car: str, kind: str, k: int, value: float, std: float, p_value: float
) -> FleetHypothesis:
    one = PARAMETERS_OF_FLEET[k]
    return FleetHypothesis(
        level,
        model,
        car,
        kind,
        one.effect,
        one.parameter,
        float(value * one.scale),
        float(std * one.scale),
        one.unit,
        p_value,
    )


def control_false_discoveries(
    found: Sequence[FleetHypothesis], rate: float = SETTINGS.false_discovery_rate
) -> list[FleetHypothesis]:
    """Return the hypotheses with `kept` set by Benjamini and Hochberg at `rate` within each kind of question.

    Kinds are families of their own, so that a model with many effects does not make its cars look faulty.
    """
    kept: set[int] = set()
    for kind in {one.kind for one in found}:
        indices = sorted(
            (k for k, one in enumerate(found) if one.kind == kind), key=lambda k: found[k].p_value
        )
        last = 0
        for rank, k in enumerate(indices, 1):
            if found[k].p_value <= rate * rank / len(indices):
                last = rank
        kept.update(indices[:last])
    return [replace(one, kept=True) if k in kept else one for k, one in enumerate(found)]
