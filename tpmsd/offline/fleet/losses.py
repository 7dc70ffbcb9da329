"""Tyres that lost air while the car stood: radii that are smaller from one drive of a car to the next.

In: the drives' statistics and dates. Out: a `FleetHypothesis` of kind `loss` per wheel. Each drive is
replayed for itself, so an alarm needs a loss during the drive; an earlier one shows in the radii alone. Pure.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special, stats

from tpmsd.car.physics.catalogue import FAULT
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.fleet.discoveries import FleetHypothesis
from tpmsd.offline.fleet.hierarchy import FleetStatistics, integrate_out_random_effect
from tpmsd.offline.fleet.parameters import RADII_OF_CONTRASTS, SCALES
from tpmsd.offline.fleet.settings import SETTINGS, FleetSettings

DAY_S = 86_400.0
_TO_CONTRASTS = np.linalg.inv(RADII_OF_CONTRASTS) / SCALES[:4, None]
"""(4, 4) scaled contrasts of a change of each radius."""


def radius_losses(
    model: str,
    cars: Sequence[str],
    stack: FleetStatistics,
    days: FloatArray,
    drive_variance: FloatArray,
    settings: FleetSettings = SETTINGS,
) -> list[FleetHypothesis]:
    """Return each car's likeliest loss of radius from some drive on, if any; `days` (n,) are their dates.

    Generalised least squares with a step of one radius and constants for all else. One-sided, for air goes
    out: a wheel counts where no wheel that became larger explains the drives better by more than its rarity.
    The p-value of the best moment is multiplied by the number of moments (Bonferroni).
    """
    variance = drive_variance.copy()
    variance[:4] = contrast_variance_between_drives(stack, days, settings)
    K, k = integrate_out_random_effect(stack.information, stack.vector, variance)
    found = []
    for car, part in zip(cars, stack.car_slices(), strict=True):
        mine = part.start + np.flatnonzero(np.isfinite(days[part]))
        mine = mine[np.argsort(days[mine], kind="stable")]
        if len(mine) < 2:
            continue
        value, std = step_changes(K[mine], k[mine])
        score = value / std
        grown = 0.5 * np.square(np.maximum(score.max(), 0.0)) - settings.grown_nats
        for wheel in np.flatnonzero(0.5 * np.square(np.minimum(score.min(axis=0), 0.0)) > grown):
            at = int(np.argmin(score[:, wheel]))
            p_value = min(1.0, len(score) * float(special.ndtr(score[at, wheel])))
            size = (100.0 * float(value[at, wheel]), 100.0 * float(std[at, wheel]))
            since_s = float(days[mine[at + 1]]) * DAY_S
            where = ("loss", FAULT.name, WHEELS[wheel])
            found.append(FleetHypothesis("car", model, car, *where, *size, "%", p_value, since_s=since_s))
    return _likeliest_of_each_car(found)


def contrast_variance_between_drives(
    stack: FleetStatistics, days: FloatArray, settings: FleetSettings = SETTINGS
) -> FloatArray:
    """Return the (4,) variance of the scaled contrasts of radii from drive to drive.

    By the median of the changes between a car's successive drives, to which single losses do not matter.
    """
    own = stack.information + settings.ridge * np.eye(stack.vector.shape[1])
    covariance = np.linalg.inv(own)
    value = np.einsum("nij,nj->ni", covariance, stack.vector)[:, :4]
    order = np.lexsort((days, stack.car))
    same = stack.car[order][1:] == stack.car[order][:-1]
    least = np.full(4, np.square(settings.drive_scales))
    if same.sum() < settings.min_changes:
        return least
    change = np.diff(value[order], axis=0)[same]
    noise = np.einsum("nii->ni", covariance)[order][:, :4]
    by_noise = np.median((noise[1:] + noise[:-1])[same], axis=0)
    median = np.square(np.median(np.abs(change), axis=0) / stats.norm.ppf(0.75))
    return np.asarray(np.maximum(least, 0.5 * (median - by_noise)), dtype=np.float64)


def step_changes(K: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return each radius's permanent step at each drive but the first, and its standard deviation.

    The step's coefficient by the Schur complement of the constants, with sums over later drives that are
    kept from one moment to the next: n drives take n steps of work.

    Args:
        K: (n, p, p) information of a car's drives in order of time.
        k: (n, p) information vectors.

    Returns:
        (n - 1, 4) changes and (n - 1, 4) standard deviations, both in parts of the radius.
    """
    p = k.shape[1]
    direction = np.zeros((p, 4))
    direction[:4] = _TO_CONTRASTS
    later = np.cumsum(K[:0:-1], axis=0)[::-1]
    later_k = np.cumsum(k[:0:-1], axis=0)[::-1]
    total = np.linalg.inv(K.sum(axis=0) + SETTINGS.ridge * np.eye(p))
    level = total @ k.sum(axis=0)
    moved = later @ direction
    information = np.einsum("pw,npw->nw", direction, moved) + SETTINGS.ridge
    information = information - np.einsum("npw,npw->nw", moved, total @ moved)
    right = later_k @ direction - np.einsum("npw,p->nw", moved, level)
    information = np.maximum(information, SETTINGS.ridge)
    return np.asarray(right / information), np.asarray(1.0 / np.sqrt(information))


def _likeliest_of_each_car(found: list[FleetHypothesis]) -> list[FleetHypothesis]:
    """Return the likeliest loss of each car: a loss of one wheel shows in the means against which the others
    are held.
    """
    best: dict[str, FleetHypothesis] = {}
    for one in found:
        if one.car not in best or one.p_value < best[one.car].p_value:
            best[one.car] = one
    return list(best.values())
