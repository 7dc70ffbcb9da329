"""Chosen terms: those that a drive demands, each in the presence of the others.

Made by `selection`; what follows it (refinement, confirmation, the report) takes it in.
"""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import LeastSquaresFit


@dataclass(frozen=True)
class Chosen:
    """A term in the presence of the other chosen ones."""

    term: Term
    gain: float
    """In sample."""
    admitted_by: float
    """Gain over the block-wise variance ratio, less the penalty."""
    heldout_gain: float
    confidence: float
    confounded_with: tuple[str, ...]
    """Effects of the catalogue that would do as well in its place."""
    values: FloatArray
    """(k,)"""
    stds: FloatArray
    """(k,) with the block-wise variance."""

    @property
    def overdispersion(self) -> float:
        """Return the block-wise over the assumed variance by which the gain was divided, at least 1."""
        ratio = max(self.gain / max(self.admitted_by + self.term.penalty, 1e-9), 1.0)
        return min(ratio, SETTINGS.selection.max_overdispersion)


@dataclass(frozen=True)
class Selection:
    """Result of the selection."""

    chosen: tuple[Chosen, ...]
    fit: LeastSquaresFit
    """Fit of calibration and chosen terms together."""
    baseline_heldout: FloatArray
    """(blocks,) held-out log-likelihood of calibration alone."""
    heldout: FloatArray
    """(blocks,) of the whole model."""
