"""Slip of the wheels, of the moment and over minutes, under each drive model: one model of grip for all
looks.

In: the probability of each drive model by the drive as a whole, and a change. Out: change hypotheses of that
change: its covariance under each model, and the log weight of each if no tyre has changed.

A drive that has shown low grip or loose ground is slippery for whoever looks: what an estimate of a few
seconds, or a mean over minutes, may be off by is what the drive's samples were off by. The slip of a driven
axle lasts, so no mean averages it out; what fluctuates between samples falls with their number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.config.model import VehicleConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.baseline.reference import RadiusReference
from tpmsd.onboard.monitor.evidence.nuisance import log_normal
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE


@dataclass(frozen=True, slots=True)
class GripHypotheses:
    """Hypotheses of one change under m drive models."""

    covariance_m2: FloatArray
    """(m, d, d) with what slips."""
    log_weight: FloatArray
    """(m,) if no tyre has changed."""


class Grip:
    """The drive models of one car, as far as they slip."""

    def __init__(self, vehicle: VehicleConfig, wheels: list[int], radius_m: FloatArray) -> None:
        """radius_m (d,) nominal, of the monitored `wheels`."""
        reference, grid = RadiusReference(vehicle), np.ix_(wheels, wheels)
        scale = np.outer(radius_m, radius_m)
        models = DRIVE_EVIDENCE.models
        self._lasting = np.stack([reference.slip_covariance(model)[grid] for model in models]) * scale
        self._scatter = np.stack([reference.scatter_covariance(model)[grid] for model in models]) * scale
        self._slipping = np.array([model.name in DRIVE_EVIDENCE.slipping for model in models])
        self._event = np.stack([np.diag((model.event_std * radius_m) ** 2) for model in models])
        self._event_share = np.array([model.event_share for model in models])
        self._known: tuple[dict[str, float], dict[int, tuple[FloatArray, FloatArray]]] = {}, {}
        """Probabilities of the models, and by number of samples what they add: asked again each second."""

    @staticmethod
    def low_grip_probability(models: dict[str, float]) -> float:
        """Return the probability that wheels slip on the drive, by the probabilities of the drive models."""
        return sum(models.get(name, 0.0) for name in DRIVE_EVIDENCE.slipping)

    @staticmethod
    def uneven_slip_probability(models: dict[str, float]) -> float:
        """Return the probability that wheels slip by varying amounts, by the probabilities of the drive
        models."""
        uneven = set(DRIVE_EVIDENCE.slipping) - set(DRIVE_EVIDENCE.by_slope)
        return sum(probability for name, probability in models.items() if name in uneven)

    def change_hypotheses(
        self, change_m: FloatArray, covariance_m2: FloatArray, samples: int, models: dict[str, float]
    ) -> GripHypotheses:
        """Return the hypotheses of a change (d,), the mean of so many samples, under each slipping drive
        model; (d, d): its covariance without slip. `models`: probability of each; empty while the drive is
        too short to tell."""
        if not models:
            return GripHypotheses(covariance_m2[None], np.zeros(1))
        if self._known[0] is not models:
            self._known = models, {}
        known = self._known[1]
        if samples not in known:
            known[samples] = self._added_covariances(samples, models)
        added_m2, log_weight = known[samples]
        total = covariance_m2 + added_m2
        return GripHypotheses(total, log_weight + log_normal(change_m, total))

    def _added_covariances(self, samples: int, models: dict[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return the covariance (m, d, d) that each hypothesis adds, and the logarithm (m,) of its
        probability."""
        chances = np.array([models[model.name] for model in DRIVE_EVIDENCE.models])
        keep = self._slipping & (chances > 0.0)
        slips = self._lasting[keep] + self._scatter[keep] / samples
        events = slips + self._event[keep] / samples**2
        added = np.concatenate([np.zeros((1, *slips.shape[1:])), slips, events])
        eventful = 1.0 - (1.0 - self._event_share[keep]) ** samples
        weights = np.concatenate(
            [[chances[~self._slipping].sum()], chances[keep] * (1.0 - eventful), chances[keep] * eventful]
        )
        with np.errstate(divide="ignore"):  # a model that is impossible weighs nothing
            return added, np.log(weights)
