"""Cars of a model and drives of a car: a hierarchical linear model, fitted by empirical Bayes.

In: per drive an information matrix and a vector (sufficient statistics, `calibration.statistics`), and which
car it was. Out: `ModelFit`: population mean with its uncertainty, spread of cars and of drives, and per car
the value shrunk to the population and the one by its own drives alone. Pure.

    drive d of car c:  theta_d = theta_c + delta_d,  delta_d ~ N(0, T),  T diagonal
    car c:             theta_c = mu + gamma_c,       gamma_c ~ N(0, G),  G diagonal

The variances are restricted maximum likelihood by the fixed point that Harville (J. Am. Stat. Assoc. 72,
1977) gives for variance components: sigma^2 <- sigma^2 score^2 / information, which keeps them positive.
Matrices are eliminated drive by drive and car by car, so the cost is linear in the number of drives.
Empirical Bayes after Efron and Morris (J. Am. Stat. Assoc. 70, 1975); degrees of freedom after Satterthwaite
(Biometrics Bulletin 2, 1946).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.fleet.settings import SETTINGS


@dataclass(frozen=True)
class FleetStatistics:
    """The statistics of the n drives of one model, in scaled units, sorted by car."""

    information: FloatArray
    """(n, p, p)"""
    vector: FloatArray
    """(n, p)"""
    car: NDArray[np.int64]
    """(n,) 0 to m - 1, rising."""

    @property
    def cars(self) -> int:
        """Number m of cars."""
        return int(self.car[-1]) + 1 if len(self.car) else 0

    def car_slices(self) -> list[slice]:
        """Return the slice of each car's drives, which are sorted by car."""
        ends = np.searchsorted(self.car, np.arange(self.cars + 1))
        return [slice(int(first), int(end)) for first, end in itertools.pairwise(ends)]

    def of_cars(self, cars: NDArray[np.bool_]) -> FleetStatistics:
        """Return the statistics of the drives of some cars, (m,) True for those; the cars are renumbered."""
        kept = cars[self.car]
        number = np.cumsum(cars) - 1
        return FleetStatistics(self.information[kept], self.vector[kept], number[self.car[kept]])


@dataclass(frozen=True)
class ModelFit:
    """A model's population and its m cars, in scaled units."""

    mean: FloatArray
    """(p,)"""
    covariance: FloatArray
    """(p, p) of the mean."""
    freedom: FloatArray
    """(p,) degrees of freedom of each mean's standard deviation."""
    car_spread: FloatArray
    """(p,) standard deviation from car to car."""
    drive_spread: FloatArray
    """(p,) standard deviation from drive to drive of a car."""
    shrunk: FloatArray
    """(m, p) each car's value given all cars."""
    shrunk_covariance: FloatArray
    """(m, p, p)"""
    own: FloatArray
    """(m, p) each car's value by its own drives."""
    own_covariance: FloatArray
    """(m, p, p)"""
    drives: NDArray[np.int64]
    """(m,) how many each car has."""

    @property
    def std(self) -> FloatArray:
        """(p,) standard deviation of the population's mean."""
        return np.sqrt(np.diag(self.covariance))


def fit_model(stack: FleetStatistics) -> ModelFit:
    """Fit the population and cars of one model by empirical Bayes; ValueError if there is no drive."""
    if not len(stack.car):
        raise ValueError("no drive")
    cars, drives = variance_components(sample_cars(stack))
    return fit_with(stack, cars, drives)


def fit_with(stack: FleetStatistics, car_variance: FloatArray, drive_variance: FloatArray) -> ModelFit:
    """Return the population and the cars for given variances (p,) from car to car and from drive to drive."""
    p = stack.vector.shape[1]
    K, k = car_information(stack, drive_variance)
    M, m = integrate_out_random_effect(K, k, car_variance)
    total = M.sum(axis=0) + SETTINGS.ridge * np.eye(p)
    V = _symmetric_part(np.linalg.inv(total))
    mu = V @ m.sum(axis=0)
    G = np.diag(car_variance)
    gain = np.eye(p) - G @ M
    shrunk = mu + np.einsum("ij,cj->ci", G, m - M @ mu)
    own_covariance = _symmetric_part(np.linalg.inv(K + SETTINGS.ridge * np.eye(p)))
    return ModelFit(
        mean=mu,
        covariance=V,
        freedom=_degrees_of_freedom(M, V, car_variance),
        car_spread=np.sqrt(car_variance),
        drive_spread=np.sqrt(drive_variance),
        shrunk=shrunk,
        shrunk_covariance=G - G @ M @ G + gain @ V @ np.swapaxes(gain, 1, 2),
        own=np.einsum("cij,cj->ci", own_covariance, k),
        own_covariance=own_covariance,
        drives=np.bincount(stack.car, minlength=stack.cars),
    )


def variance_components(stack: FleetStatistics) -> tuple[FloatArray, FloatArray]:
    """Return the (p,) variances from car to car and from drive to drive, by restricted maximum likelihood.

    A level that the data cannot show (one car; one drive per car) has the variance zero.
    """
    p = stack.vector.shape[1]
    cars = np.full(p, SETTINGS.first_scales**2 if stack.cars > 1 else 0.0)
    drives = np.full(p, SETTINGS.first_scales**2 if len(stack.car) > stack.cars else 0.0)
    for _ in range(SETTINGS.max_iterations):
        before = np.sqrt(np.concatenate([cars, drives]))
        cars, drives = _next_variances(stack, cars, drives)
        after = np.sqrt(np.concatenate([cars, drives]))
        if np.all(
            np.abs(after - before) < SETTINGS.converged_share * np.maximum(after, SETTINGS.small_scales)
        ):
            break
    return cars, drives


def _next_variances(
    stack: FleetStatistics, cars: FloatArray, drives: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return both variances (p,) after one step of the fixed-point iteration."""
    p = stack.vector.shape[1]
    Kd, kd = integrate_out_random_effect(stack.information, stack.vector, drives)
    K, k = _sum_by_car(stack, Kd), _sum_by_car(stack, kd)
    M, m = integrate_out_random_effect(K, k, cars)
    V = np.linalg.inv(M.sum(axis=0) + SETTINGS.ridge * np.eye(p))
    mu = V @ m.sum(axis=0)
    score = m - M @ mu
    information = np.einsum("cii->ci", M) - np.einsum("cij,jk,cki->ci", M, V, M)
    G = np.diag(cars)
    gain = np.eye(p) - G @ M
    theta = mu + score @ G
    P = G - G @ M @ G + gain @ V @ np.swapaxes(gain, 1, 2)
    score_d = kd - np.einsum("dij,dj->di", Kd, theta[stack.car])
    # The diagonal of K P K, of which K is symmetric.
    information_d = np.einsum("dii->di", Kd) - np.einsum("dij,dij->di", Kd @ P[stack.car], Kd)
    return _scaled_variance(cars, score, information), _scaled_variance(drives, score_d, information_d)


def _scaled_variance(variance: FloatArray, score: FloatArray, information: FloatArray) -> FloatArray:
    """Return the (p,) variance times its squared score over its information, within 0.05 to 20 times."""
    squares, total = np.square(score).sum(axis=0), information.sum(axis=0)
    ratio = np.divide(squares, total, out=np.ones_like(total), where=total > SETTINGS.ridge)
    return np.asarray(variance * np.clip(ratio, 0.05, 20.0))


def car_information(stack: FleetStatistics, drive_variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the information (m, p, p) and vector (m, p) of each car, summed over its drives."""
    p = stack.vector.shape[1]
    K, k = np.zeros((stack.cars, p, p)), np.zeros((stack.cars, p))
    for begin in range(0, len(stack.car), SETTINGS.chunk_drives):
        part = slice(begin, begin + SETTINGS.chunk_drives)
        Kd, kd = integrate_out_random_effect(stack.information[part], stack.vector[part], drive_variance)
        np.add.at(K, stack.car[part], Kd)
        np.add.at(k, stack.car[part], kd)
    return K, k


def integrate_out_random_effect(
    J: FloatArray, h: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the information (n, p, p) and vector (n, p) once a random effect of this variance (p,) is
    integrated out.

    J (I + T J)^-1 and (I + J T)^-1 h; exact for variances of zero, too.
    """
    p = h.shape[1]
    both = np.linalg.solve(np.eye(p) + J * variance, np.concatenate([J, h[:, :, None]], axis=2))
    return _symmetric_part(both[:, :, :p]), both[:, :, p]


def _sum_by_car(stack: FleetStatistics, values: FloatArray) -> FloatArray:
    """Return the (m, ...) sums over each car's drives."""
    begins = np.searchsorted(stack.car, np.arange(stack.cars))
    return np.add.reduceat(values, begins, axis=0)


def _symmetric_part(matrices: NDArray[np.floating[Any]]) -> FloatArray:
    return np.asarray(0.5 * (matrices + np.swapaxes(matrices, -1, -2)), dtype=np.float64)


def _degrees_of_freedom(M: FloatArray, V: FloatArray, car_variance: FloatArray) -> FloatArray:
    """Return the (p,) degrees of freedom of the means' variances, whose part by the cars' spread is itself
    estimated.

    The spread is taken at one standard error above its estimate: an estimate of zero from few cars is not the
    certainty that cars are alike.
    """
    weight = np.einsum("cii->ci", M)
    sum_1, sum_2 = weight.sum(axis=0), np.square(weight).sum(axis=0)
    effective = np.divide(sum_1**2, sum_2, out=np.ones_like(sum_1), where=sum_2 > 0.0)
    error = np.sqrt(np.divide(2.0, sum_2, out=np.zeros_like(sum_2), where=sum_2 > 0.0))
    # A mean of `effective` cars has this part of its variance from their spread.
    part = (car_variance + error) / np.maximum(effective, 1.0)
    share = np.minimum(part / np.maximum(np.diag(V), 1e-300), 1.0)
    return np.asarray(np.maximum(effective - 1.0, 1.0) / np.maximum(share, 1e-3) ** 2)


def sample_cars(stack: FleetStatistics) -> FleetStatistics:
    """Return the statistics of all drives of evenly chosen cars, about `spread_drives` drives at most."""
    if len(stack.car) <= SETTINGS.spread_drives:
        return stack
    wanted = max(2, round(stack.cars * SETTINGS.spread_drives / len(stack.car)))
    chosen = np.zeros(stack.cars, dtype=np.bool_)
    chosen[np.linspace(0, stack.cars - 1, wanted).round().astype(np.int64)] = True
    return stack.of_cars(chosen)
