"""Interface of every estimator of tyre radii.

In: `Tick`s. Out: a `RadiusEstimate` per tick. An estimator does no I/O, reads no clock and draws from the
`numpy.random.Generator` it was given.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Protocol

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.timeline.tick import Tick


class RadiusStatement(NamedTuple):
    """Statement of the radii, apart from the chance that one of them has just changed: p(x) = rho p(x |
    change) + (1 - rho) p(x | none), with a change within `SETTINGS.recent_change_s`.
    """

    mean_m: FloatArray
    """(d,) radius minus nominal, given the more probable of the two answers; (4,) and NaN for a wheel that is
    not estimated in an estimate."""
    covariance_m2: FloatArray
    """(d, d) its covariance."""
    change_probability: float
    """rho."""


class RadiusEstimate(NamedTuple):
    """Joint posterior of the four radii, and the pose that came with it, at the end of one tick. A named
    tuple: one is made in every tick."""

    time_s: float
    deviation_m: FloatArray
    """(4,) posterior mean of radius minus nominal; NaN for a wheel that is not estimated."""
    covariance_m2: FloatArray
    """(4, 4) its covariance; rows and columns of unestimated wheels are NaN."""
    noise_std_m: FloatArray
    """(4,) standard deviation of one tick's radius error (the paper's sqrt(Sigma))."""
    informative: bool
    """True if radii were learned from this tick (moving, gentle, wheels valid)."""
    informative_s: float
    """Driving time that has taught the radii so far."""
    speed_mps: float
    yaw_rate_radps: float
    east_m: float
    north_m: float
    heading_rad: float
    position_std_m: float
    heading_std_rad: float
    gnss_age_s: float
    """Time since the last fix that was used; infinite before the first."""
    effective_particles: float
    ancestors: float = math.nan
    """Particles of one or two minutes ago that have descendants; NaN where nothing is drawn."""
    between_std_m: float = math.nan
    """Standard deviation of the mean radii between the particles, root mean square over the wheels; NaN where
    nothing is drawn."""
    stated: RadiusStatement | None = None
    """Statement after the last block of odometry; None before the first, and of filters that assume no
    changes of single wheels. Judgements take `deviation_m` and `covariance_m2`, which hold both answers.
    """


NIGHT_S = 1000.0
"""A snapshot of an earlier start is taken up as after so much driving: what a night can do to radii."""


class Estimator(Protocol):
    """A filter that turns ticks into radius estimates."""

    def step(self, tick: Tick) -> RadiusEstimate:
        """Advance by one tick. Never raises on odd input: what cannot be used is left out."""
        ...

    def snapshot(self) -> dict[str, Any]:
        """Return a JSON-serialisable summary of what was learned, enough for `restore` on another start."""
        ...

    def restore(self, saved: dict[str, Any], since_s: float = NIGHT_S) -> None:
        """Restore a snapshot of `since_s` seconds of driving ago, or of a night; ValueError if it does not
        fit."""
        ...


MAX_DEVIATION_M = 0.2
"""No tyre that a car drives on is off its nominal radius by so much: an estimate beyond it has diverged."""


def unsound_reason(estimate: RadiusEstimate, wheels: list[int]) -> str:
    """Return why the radii of these wheels cannot be used as an estimate, in a few words; empty if they
    can."""
    # Plain numbers: for so few numpy takes ten times as long, and this is asked every tick.
    deviation, spread = estimate.deviation_m.tolist(), estimate.covariance_m2.ravel().tolist()
    variances = spread[::5]
    if len(wheels) < 4:
        spread = [spread[4 * one + other] for one in wheels for other in wheels]
        deviation, variances = [deviation[one] for one in wheels], [variances[one] for one in wheels]
    if not math.isfinite(sum(deviation) + sum(spread)):
        return "a radius is not a number"
    if min(variances) < 0.0:
        return "a variance is negative"
    if max(map(abs, deviation)) > MAX_DEVIATION_M:
        return f"a radius is off by more than {MAX_DEVIATION_M:g} m"
    return ""
