"""What was found under the noise so far: what each alternative noise is given, and gives.

In: nothing (a plain record). Out: `Found`.
"""

from __future__ import annotations

from typing import NamedTuple

from tpmsd.offline.diagnosis.prepared.study import Study
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.inference.least_squares import Evidence


class Found(NamedTuple):
    """What is chosen, and of what."""

    study: Study
    """Each drive with its noise."""
    selection: Selection
    evidence: Evidence
    """Of the study under that noise."""
