"""What a loss of pressure does to a tyre's effective rolling radius.

In: the share of the pressure that is lost. Out: the change of radius. So a fault can be named in per cent
pressure.
"""

from __future__ import annotations

from tpmsd.errors import ConfigError

REFERENCE_RADIUS_M = 0.304
"""205/60R15 at 4 kN, 220 kPa, 20 m/s, for which the sizes below hold."""
_SIZE_M = 6.032e-3
_PNEUMATIC_SHARE = 0.7222


def radius_change_for_pressure_loss(fraction: float, radius_m: float = REFERENCE_RADIUS_M) -> float:
    """Change of effective rolling radius in metres when `fraction` of the pressure is lost.

    A tyre of which the share B of the vertical stiffness comes from its pressure sinks by 1/(1 - B x) - 1 of
    its deflection when the share x of the pressure is lost, so delta_r = -A x / (1 - B x). A = 6.03 mm and B
    = 0.722 pass through all three sizes that the Magic Formula 6.1 gives for a 205/60R15 at 4 kN, 220 kPa and
    20 m/s: -1.41 mm at -20 %, -1.84 mm at -25 %, -2.31 mm at -30 %. Beyond -30 % the form extrapolates (a
    flat tyre: -22 mm). Other sizes of tyre are scaled with their radius; make and load change the figure by a
    factor of up to two (paper 000 saw 1.5 mm for 2.8 to 1.5 bar on a stiff tyre).

    `fraction` is in [-0.5, 1]; negative for over-inflation, which makes the radius grow. ConfigError outside.
    """
    if not -0.5 <= fraction <= 1.0:
        raise ConfigError(f"pressure loss of {100 * fraction:g} % is outside -50 to 100 %")
    change = -_SIZE_M * fraction / (1.0 - _PNEUMATIC_SHARE * fraction)
    return change * radius_m / REFERENCE_RADIUS_M + 0.0
