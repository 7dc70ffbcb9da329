"""Findings under the noise so far: input and output of each alternative noise.

In: nothing (a plain record). Out: `FoundTerms`.
"""

from __future__ import annotations

from typing import NamedTuple

from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.inference.least_squares import Evidence


class FoundTerms(NamedTuple):
    """Chosen terms, with the regression that they belong to."""

    regression: Regression
    """Each drive with its noise."""
    selection: Selection
    evidence: Evidence
    """Gain of the regression under that noise."""
