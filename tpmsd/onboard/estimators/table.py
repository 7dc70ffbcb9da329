"""The published filters as rows of one table: which pieces each is made of.

In: nothing. Out: `TABLE`, `row_of`. A row says what a filter is; `build` makes it for a car. Another
likelihood, motion or radius model is a piece with the same functions, and a row that names it.

| name | representation | motion | radii | likelihood | resampling, changes |
| --- | --- | --- | --- | --- | --- |
| `gaussian-sum` | mixture | wheels in | states, beside nuisances | robust, Student-t | enumerate, prune |
| `mpf-pn-paper` | samples | wheels in | NIW, no floors | Gaussian | systematic, none; no gates |
| `mpf-pn` | Kalman filters | wheels in | states, beside nuisances | robust, Student-t | systematic, drawn |
| `mpf-pn-niw` | samples | wheels in | NIW with floors | Student-t | systematic, Poisson |
| `mpf-mn` | samples | walk, wheels measured | NIW with floors | Student-t, learned | systematic, none |
| `aug-pf` | samples | wheels in | mu and Sigma walk | Student-t | systematic, none |
| `aug-ekf`, `aug-ukf` | Gaussian | wheels in | mu and Sigma are states | robust scalar | none |

`mpf-pn-paper` is [Lundquist 2013, Table I] to the letter, with the exact forms of (21) and (24) (`niw`); the
pose it starts from is found by fixes, of which the paper says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from tpmsd.onboard.estimators.bank.marginal import MarginalPieces
from tpmsd.onboard.estimators.bank.mixture import MixturePieces
from tpmsd.onboard.estimators.published.changes import PoissonChanges
from tpmsd.onboard.estimators.published.gaussian import GaussianPieces, linearised, unscented
from tpmsd.onboard.estimators.published.gnss_likelihood import gaussian_log
from tpmsd.onboard.estimators.published.position_noise import PositionNoise
from tpmsd.onboard.estimators.published.radius_models import Floors, NiwRadii, WalkingRadii
from tpmsd.onboard.estimators.published.sampled_motion import WheelsMeasured
from tpmsd.onboard.estimators.published.samples import SampledPieces
from tpmsd.onboard.estimators.radius_filter import GATED, Gates
from tpmsd.onboard.estimators.settings import SETTINGS


@dataclass(frozen=True, slots=True)
class Row:
    """Pieces and gates that make one filter of the table."""

    pieces: SampledPieces | GaussianPieces | MixturePieces | MarginalPieces
    gates: Gates = GATED


_PAPER = SampledPieces(
    radii=NiwRadii(floors=None),
    likelihood=gaussian_log,
    positions_alone=True,
    heading_after=0.0,
    position_floor_m=SETTINGS.resolution_m,
)
TABLE: MappingProxyType[str, Row] = MappingProxyType(
    {
        "gaussian-sum": Row(MixturePieces(), Gates(fix_interval_s=SETTINGS.fix_interval_s)),
        "mpf-pn-paper": Row(_PAPER, Gates(ticks=False, fixes=False, printed_steering=True)),
        "mpf-pn": Row(MarginalPieces(), Gates(fix_interval_s=SETTINGS.fix_interval_s)),
        "mpf-pn-niw": Row(SampledPieces(radii=NiwRadii(floors=Floors(apart=True)), changes=PoissonChanges())),
        "mpf-mn": Row(SampledPieces(motion=WheelsMeasured(), position_noise=PositionNoise())),
        "aug-pf": Row(SampledPieces(radii=WalkingRadii())),
        "aug-ekf": Row(GaussianPieces(linearised)),
        "aug-ukf": Row(GaussianPieces(unscented)),
    }
)
"""[filter] method -> the filter."""
ALIASES = MappingProxyType({"mpf-rb": "gaussian-sum"})
"""Names of earlier versions, still valid in configuration and state files."""


def row_of(method: str) -> Row | None:
    """Return the row of a method or of its alias; None if there is none."""
    return TABLE.get(ALIASES.get(method, method))
