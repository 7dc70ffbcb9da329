"""Effective rolling radius of a tyre by its pressure, and back.

In: the share of the pressure that is lost, or the change of radius. Out: the other, with its uncertainty. So
a fault can be named in per cent pressure, and an alarm can say how much pressure is missing.

A tyre under the load F sinks by F/c. Its vertical stiffness c rises with the pressure p, in a straight line
c = c0 (1 - B + B p/p0): the share B comes from the air, the rest from the carcass. So when the share x of the
pressure is lost, it sinks by F/c0 (1/(1 - B x) - 1) more, and the share H of this shows in the effective
rolling radius:

    delta_r = -H F/c0 * B x / (1 - B x) = -A x / (1 - B x)

Sources: c and B by the size of a tyre from Rhyne, Development of a Vertical Stiffness Relationship for Belted
Radial Tires, Tire Science and Technology 33(3), 2005. H is near a third by the classical estimate of the
rolling radius (free radius less a third of the deflection); 0.39 with Rhyne's stiffness gives the sizes of
the Magic Formula 6.1 below to 3 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tpmsd.car.config.model import TyreConfig
from tpmsd.car.config.rules import TYRE_SIZE
from tpmsd.foundation.errors import ConfigError

REFERENCE_RADIUS_M = 0.304
"""205/60R15 at 4 kN, 220 kPa, 20 m/s, for which the sizes below hold."""
_SIZE_M = 6.032e-3
_PNEUMATIC_SHARE = 0.7222
RADIUS_SHARE = 0.39
"""H: the share of a change of deflection that shows in the effective rolling radius."""
DEFAULT_LOAD_N, DEFAULT_PRESSURE_PA = 4000.0, 220e3
UNKNOWN_TYRE_STD, KNOWN_TYRE_STD, MEASURED_STD = 0.25, 0.15, 0.10
"""Relative uncertainty of a pressure estimated from a radius: make and load of an unknown tyre change it by a
factor of up to two; of a tyre of known size; of one whose curve was measured."""
_KGF_PER_MM = 9806.65
"""N/m."""


def radius_change_for_pressure_loss(fraction: float, radius_m: float = REFERENCE_RADIUS_M) -> float:
    """Change of effective rolling radius in metres when `fraction` of the pressure is lost.

    A = 6.03 mm and B = 0.722 pass through all three sizes that the Magic Formula 6.1 gives for a 205/60R15 at
    4 kN, 220 kPa and 20 m/s: -1.41 mm at -20 %, -1.84 mm at -25 %, -2.31 mm at -30 %. Beyond -30 % the form
    extrapolates (a flat tyre: -22 mm). Other sizes of tyre are scaled with their radius; make and load change
    the figure by a factor of up to two ([Lundquist 2013] saw 1.5 mm for 2.8 to 1.5 bar on a stiff tyre).

    `fraction` is in [-0.5, 1]; negative for over-inflation, which makes the radius grow. ConfigError outside.
    """
    return TyreModel(_SIZE_M * radius_m / REFERENCE_RADIUS_M, _PNEUMATIC_SHARE).radius_change_m(fraction)


def stiffness(size: str, pressure_pa: float) -> tuple[float, float]:
    """Return the vertical stiffness, N/m, of a tyre size (as `205/60R15`) and B, the air's share of it.

    Rhyne 2005: c = 0.00028 p sqrt((1.03 - 0.004 a) w (w a/50 + d)) + 3.45 in kgf/mm, with p in kPa, width w
    and rim d in mm, aspect ratio a in per cent. ConfigError if the size cannot be read.
    """
    match = TYRE_SIZE.match(size.strip())
    if match is None:
        raise ConfigError(f"[tyre] size: {size!r} is not of the form 205/60R15")
    width, aspect, rim = float(match[1]), float(match[2]), 25.4 * float(match[3])
    inner = (1.03 - 0.004 * aspect) * width * (width * aspect / 50.0 + rim)
    air = 0.00028 * pressure_pa / 1e3 * math.sqrt(inner)
    total = air + 3.45
    return total * _KGF_PER_MM, air / total


@dataclass(frozen=True, slots=True)
class TyreModel:
    """delta_r = -A x / (1 - B x), or a measured curve."""

    size_m: float
    """A."""
    pneumatic_share: float
    """B."""
    curve: tuple[tuple[float, float], ...] = ()
    """Measured pairs (share of the pressure lost, loss of radius in m), both rising from above zero."""
    model_std: float = UNKNOWN_TYRE_STD
    """Relative standard deviation of a pressure estimated from a radius, by the model alone."""

    def radius_change_m(self, fraction: float) -> float:
        """Change of radius when `fraction` of the pressure is lost; ConfigError outside [-0.5, 1]."""
        if not -0.5 <= fraction <= 1.0:
            raise ConfigError(f"pressure loss of {100 * fraction:g} % is outside -50 to 100 %")
        if self.curve:
            return -_interpolate_or_extrapolate(((0.0, 0.0), *self.curve), fraction)
        return -self.size_m * fraction / (1.0 - self.pneumatic_share * fraction) + 0.0

    def pressure_loss(self, radius_change_m: float, std_m: float = 0.0) -> tuple[float, float]:
        """Return the share of the pressure that is lost and its std; NaN where the change is unknown.

        Negative for a tyre that grew. The uncertainty is that of the radius through the slope of the curve,
        and that of the model. Held to [-1, 1]: a tyre cannot lose more than it has.
        """
        if not math.isfinite(radius_change_m):
            return math.nan, math.nan
        loss, slope = self._loss_and_slope(-radius_change_m)
        std = math.hypot(std_m / slope, self.model_std * loss)
        return min(max(loss, -1.0), 1.0), min(std, 1.0)

    def _loss_and_slope(self, lost_m: float) -> tuple[float, float]:
        """Return the share of pressure lost for a loss of radius, and metres of radius per share there."""
        if self.curve:
            points = ((0.0, 0.0), *self.curve)
            turned = tuple((radius, share) for share, radius in points)
            loss = _interpolate_or_extrapolate(turned, lost_m)
            step = 1e-3
            return loss, (
                _interpolate_or_extrapolate(points, loss + step)
                - _interpolate_or_extrapolate(points, loss - step)
            ) / (2 * step)
        # x = y/(A + B y). A tyre that grew much would leave the form; the slope at zero goes on there.
        if lost_m < 0.0:
            return lost_m / self.size_m, self.size_m
        loss = lost_m / (self.size_m + self.pneumatic_share * lost_m)
        return loss, self.size_m / (1.0 - self.pneumatic_share * loss) ** 2


def tyre_model(tyre: TyreConfig, radius_m: float) -> TyreModel:
    """Return the model that a configuration describes, for a wheel of this nominal radius; ConfigError if
    none.
    """
    if tyre.curve_pressure_percent:
        pairs = zip(tyre.curve_pressure_percent, tyre.curve_radius_mm, strict=True)
        curve = tuple((share / 100.0, radius / 1e3) for share, radius in pairs)
        return TyreModel(_SIZE_M, _PNEUMATIC_SHARE, curve, MEASURED_STD)
    if tyre.size is None and tyre.stiffness_npm is None:
        scale = radius_m / REFERENCE_RADIUS_M * tyre.load_n / DEFAULT_LOAD_N
        return TyreModel(_SIZE_M * scale, _PNEUMATIC_SHARE)
    share = _PNEUMATIC_SHARE
    vertical = tyre.stiffness_npm
    if tyre.size is not None:
        by_size, share = stiffness(tyre.size, 1e3 * tyre.pressure_kpa)
        vertical = by_size if vertical is None else vertical
    assert vertical is not None
    return TyreModel(RADIUS_SHARE * tyre.load_n / vertical * share, share, (), KNOWN_TYRE_STD)


def _interpolate_or_extrapolate(points: tuple[tuple[float, float], ...], x: float) -> float:
    """Return y at x: linear between the points, and beyond them by the slope of the nearest two."""
    k = 1
    while k < len(points) - 1 and x > points[k][0]:
        k += 1
    (x0, y0), (x1, y1) = points[k - 1], points[k]
    return y0 + (y1 - y0) * (x - x0) / (x1 - x0)
