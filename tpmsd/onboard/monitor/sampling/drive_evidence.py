"""Evidence of a drive as a whole under each drive model: as learned, another load, a trailer, low grip.

In: the `RadiusReference` as the drive began and a sample every 20 s. Out: `ChangeHypotheses`: change
hypotheses with their covariances and log weights, for the comparison of hypotheses. A drive model is an
alternative of every loss: what it explains better is no loss.

Wheels of another size since before the drive are a row of every bank. Where the radii jump on the way, a
second set of banks begins with the reference that the first began with. Of it the rows of another size count,
with the likelihood that the first set gave to what was before the jump: so a size that came on the way (a
receiver that scales, chains without a stop) is a row of the same posterior, and no drive model takes it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.baseline.reference import RadiusReference
from tpmsd.onboard.monitor.drive_settings import DriveModel
from tpmsd.onboard.monitor.evidence.change_bank import ChangeBank
from tpmsd.onboard.monitor.evidence.nuisance import Nuisance, log_normal
from tpmsd.onboard.monitor.evidence.sizes import size_rows
from tpmsd.onboard.monitor.sampling.common_mode_noise import CommonModeNoise
from tpmsd.onboard.monitor.sampling.slip_sums import Slope
from tpmsd.onboard.monitor.settings import BASELINE, DRIVE_EVIDENCE, JUDGE


@dataclass(frozen=True, slots=True)
class ChangeHypotheses:
    """Change hypotheses of a drive, n of them over all drive models and rows of sizes."""

    change_m: FloatArray
    """(n, d)"""
    covariance_m2: FloatArray
    """(n, d, d) without what is nuisance."""
    log_weight: FloatArray
    """(n,) log of prior probability times likelihood of the drive, had no tyre changed."""
    model: NDArray[np.intp]
    """(n,) index of the drive model."""
    row: NDArray[np.intp]
    """(n,) index of the row of sizes, and ..."""
    index: NDArray[np.intp]
    """(n,) ... of the hypothesis among those of its model."""
    size: FloatArray
    """(n,) of that row, relative, if no tyre has lost air, and ..."""
    size_std: FloatArray
    """(n,)"""
    samples: int = 0
    """Number of samples of the drive."""

    def with_nuisance(self, nuisance_m2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the covariance of each change (n, d, d) and the log weights (n,) if no tyre has changed,
        where radii may also have changed by a nuisance of covariance (d, d).

        What is nuisance belongs to that likelihood as much as to the size of a loss: it is 0 in `log_weight`,
        normal with `nuisance_m2` here, and the ratio of the two is N(change; 0, C + H) / N(change; 0, C).
        """
        total_m2 = self.covariance_m2 + nuisance_m2
        log_density = log_normal(self.change_m, total_m2) - log_normal(self.change_m, self.covariance_m2)
        return total_m2, self.log_weight + log_density

    def likely_indices(self, log_weight: FloatArray) -> NDArray[np.intp]:
        """Return the indices of the change hypotheses that are not negligible: under the others even the
        change that fits best is less likely than the best hypothesis of `log_weight` (n,) without any
        loss."""
        solved = np.linalg.solve(self.covariance_m2, self.change_m[:, :, None])[:, :, 0]
        most = self.log_weight + 0.5 * np.einsum("nd,nd->n", self.change_m, solved)
        return np.flatnonzero(most > log_weight.max() - DRIVE_EVIDENCE.negligible_nats)

    @property
    def log_marginal(self) -> float:
        """Log-likelihood of the drive with no loss, over all models and rows."""
        return float(np.logaddexp.reduce(self.log_weight))

    def only_resized(self, log_before: float) -> ChangeHypotheses:
        """Return the hypotheses with wheels of another size, after a beginning of the drive of this
        log-likelihood."""
        kept = self.row > 0
        values: dict[str, Any] = {name: getattr(self, name)[kept] for name in _OF_EACH}
        values["log_weight"] = values["log_weight"] + log_before
        return replace(self, **values)

    def joined_with(self, other: ChangeHypotheses) -> ChangeHypotheses:
        """Return these hypotheses and, behind them, the others."""
        values: dict[str, Any] = {
            name: np.concatenate([getattr(one, name) for one in (self, other)]) for name in _OF_EACH
        }
        return replace(self, **values)

    def model_probabilities(self, chances: FloatArray) -> dict[str, float]:
        """Return the probability of each drive model by the posterior probabilities (n,) of the changes."""
        return {
            model.name: float(chances[self.model == k].sum()) for k, model in enumerate(DRIVE_EVIDENCE.models)
        }


@dataclass(frozen=True, slots=True)
class ChangeSinceStart:
    """Change of the radii since a drive began by a part of its samples, m times: under each drive model, and
    again since a jump."""

    change_m: FloatArray
    """(m, d)"""
    covariance_m2: FloatArray
    """(m, d, d) without what is nuisance."""
    log_weight: FloatArray
    """(m,) log of prior probability times likelihood, had no tyre changed."""
    resized: NDArray[np.bool_]
    """(m,) true for those since a jump, of which wheels of another size count alone."""

    def joined_with(self, other: ChangeSinceStart) -> ChangeSinceStart:
        """Return these changes and, behind them, the others."""
        values: dict[str, Any] = {
            part.name: np.concatenate([getattr(self, part.name), getattr(other, part.name)])
            for part in fields(ChangeSinceStart)
        }
        return ChangeSinceStart(**values)


_OF_EACH = [part.name for part in fields(ChangeHypotheses) if part.name != "samples"]
"""Names of the fields that have a row for each hypothesis."""


class DriveEvidence:
    """Evidence of one drive for changes of the radii, under each drive model."""

    def __init__(self, reference: RadiusReference, wheels: list[int], radius_m: FloatArray) -> None:
        """`radius_m` (d,) nominal, of the monitored wheels."""
        self._begin = reference.copy(), wheels, radius_m
        self._whole = _Banks(*self._begin)
        self._since_jump: _Banks | None = None
        self._log_before = 0.0
        """Log-likelihood of what was before the jump, and log prior of a size that comes on the way."""
        self.change_hypotheses: ChangeHypotheses | None = None
        """Changes by the samples so far; None as long as they are too few."""
        self._history: deque[ChangeSinceStart] = deque(maxlen=BASELINE.recent_samples + 2)
        """After each of the last samples."""

    def change_before(self, samples: int) -> ChangeSinceStart | None:
        """Return the change since the start by all but the last so many samples; None where they are all, or
        not kept."""
        return self._history[-1 - samples] if samples < len(self._history) else None

    def note_jump(self) -> None:
        """Record that the radii have jumped: wheels may be of another size from now on. A jump of which
        enough samples were seen stays."""
        young = self._since_jump is None or self._since_jump.samples < JUDGE.full_samples
        if young and self._whole.samples:
            self._since_jump = _Banks(*self._begin)
            self._log_before = self._whole.log_likelihood + math.log(DRIVE_EVIDENCE.resized_while_driving)

    def update(
        self,
        deviation_m: FloatArray,
        estimate_m2: FloatArray,
        unsettled_m2: FloatArray,
        features: FloatArray,
        elapsed_s: float,
        slip: Slope | None = None,
    ) -> None:
        """Update `change_hypotheses` by a sample: radius minus nominal (d,), its covariance (d, d), that of
        what the estimate's memory has not followed (d, d), and features (d, SIZE); `elapsed_s` of driving
        since the one before; `slip`: the slip slope since then."""
        sample = deviation_m, estimate_m2, unsettled_m2, features, elapsed_s, slip
        found = self.change_hypotheses = self._whole.update(*sample)
        beginning = self._whole.change_since_first()
        if self._since_jump is None:
            self._history.append(beginning)
            return
        young = self._since_jump.update(*sample)
        self._history.append(beginning.joined_with(self._since_jump.change_since_first(self._log_before)))
        if found is None or young is None or not np.any(young.row > 0):
            return
        young = young.only_resized(self._log_before)
        if young.log_marginal < found.log_marginal - DRIVE_EVIDENCE.negligible_nats:
            self._since_jump = None
        else:
            self.change_hypotheses = found.joined_with(young)

    def reference_fitted_jointly(self, change_index: int) -> RadiusReference:
        """Return the reference by the drive, fitted jointly with the change of this index into
        `change_hypotheses`."""
        assert self.change_hypotheses is not None
        kept, banks = self.change_hypotheses, self._whole
        if change_index >= banks.hypotheses:
            assert self._since_jump is not None
            banks = self._since_jump
        model, row, index = (int(part[change_index]) for part in (kept.model, kept.row, kept.index))
        return banks.reference_fitted_jointly(model, row, index)


class _Banks:
    """A bank for each drive model, since the drive began or since a jump."""

    def __init__(self, reference: RadiusReference, wheels: list[int], radius_m: FloatArray) -> None:
        """`radius_m` (d,) nominal, of the monitored wheels."""
        index = np.ix_(wheels, wheels)
        self._radius = radius_m
        self._sizes = size_rows(tuple(wheels))
        self._banks = [
            ChangeBank(reference.widened(model), reference.scatter_covariance(model)[index])
            for model in DRIVE_EVIDENCE.models
        ]
        # Neighbouring samples of a fluctuation are similar: each counts for less.
        similar = math.exp(-BASELINE.sample_every_s / JUDGE.nuisance_s)
        quick = Nuisance(0.0, 0.0, JUDGE.nuisance.side, JUDGE.nuisance.own)
        self._quick = quick.covariance(wheels, np.ones(len(wheels))) * (1.0 + similar) / (1.0 - similar)
        self._level = CommonModeNoise(reference)
        self._slopes = 0
        """Slip slopes that were taken."""
        self.samples = 0
        self.hypotheses = 0
        """Number of the changes that were returned last."""

    def update(
        self,
        deviation_m: FloatArray,
        estimate_m2: FloatArray,
        unsettled_m2: FloatArray,
        features: FloatArray,
        elapsed_s: float,
        slip: Slope | None,
    ) -> ChangeHypotheses | None:
        """Update by a sample as `DriveEvidence.update`; return the changes by now, None as long as there are
        too few."""
        self.samples += 1
        scale = np.outer(self._radius, self._radius)
        noise = (DRIVE_EVIDENCE.estimate_share * estimate_m2 + unsettled_m2) / scale + self._quick
        own = estimate_m2 / scale
        noise = noise + self._level.update(deviation_m / self._radius, own, features)
        self._slopes += slip is not None
        for bank in self._banks:
            bank.update(deviation_m / self._radius, noise, features, elapsed_s, self._sizes)
            if slip is not None:
                bank.update_slip(slip)
        found = [bank.changes(self._sizes) for bank in self._banks]
        if not found[0].log_weight.size:
            return None
        self.hypotheses = len(found) * found[0].log_weight.size
        log_weight = np.stack(
            [
                self._log_prior(model) + bank.log_likelihood + one.log_weight
                for model, bank, one in zip(DRIVE_EVIDENCE.models, self._banks, found, strict=True)
            ]
        )
        model, row, index = (index.ravel() for index in np.indices(log_weight.shape))
        size, variance = (
            np.stack([getattr(one, name) for one in found])[model, row] for name in ("size", "size_variance")
        )
        return ChangeHypotheses(
            change_m=np.stack([one.change for one in found]).reshape(-1, self._radius.size) * self._radius,
            covariance_m2=np.stack([one.covariance for one in found]).reshape(-1, *scale.shape) * scale,
            log_weight=log_weight.ravel(),
            model=model,
            row=row,
            index=index,
            size=size,
            size_std=np.sqrt(variance),
            samples=self.samples,
        )

    def change_since_first(self, log_before: float | None = None) -> ChangeSinceStart:
        """Return the change since the first sample; `log_before`: log-likelihood of the samples before a
        jump, None where these banks began with the drive."""
        found = [bank.change_since_first() for bank in self._banks]
        return ChangeSinceStart(
            np.stack([change for change, _ in found]) * self._radius,
            np.stack([covariance for _, covariance in found]) * np.outer(self._radius, self._radius),
            self._log_weights() + (log_before or 0.0),
            np.full(len(found), log_before is not None),
        )

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood of the samples over all drive models if no tyre has changed."""
        return float(np.logaddexp.reduce(self._log_weights()))

    def _log_weights(self) -> FloatArray:
        """Return the (m,) log of the prior of each drive model times the likelihood if no tyre has
        changed."""
        banks = zip(DRIVE_EVIDENCE.models, self._banks, strict=True)
        return np.array([self._log_prior(model) + bank.log_likelihood for model, bank in banks])

    def _log_prior(self, model: DriveModel) -> float:
        """Return the log prior of a drive model; -inf for one that needs slip slopes as long as there are
        none."""
        known = self._slopes > 0 or model.name not in DRIVE_EVIDENCE.by_slope
        return math.log(model.prior) if known else -math.inf

    def reference_fitted_jointly(self, model: int, row: int, index: int) -> RadiusReference:
        """Return the reference fitted jointly with the change of this drive model, row of sizes and index."""
        return self._banks[model].reference_fitted_jointly(row, index, self._sizes)
