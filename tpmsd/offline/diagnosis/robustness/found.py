"""Findings under the noise so far: input and output of each alternative noise.

In: nothing (a plain record). Out: `Found`.
"""

from __future__ import annotations

from typing import NamedTuple

from tpmsd.offline.diagnosis.prepared.study import Study
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.inference.least_squares import Evidence


class Found(NamedTuple):
    """Chosen terms, with the study that they belong to."""

    study: Study
    """Each drive with its noise."""
    selection: Selection
    evidence: Evidence
    """Gain of the study under that noise."""
