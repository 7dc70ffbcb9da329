"""Standard deviation of a position.

In: fix quality, HDOP, the receiver's own error estimate (GST). Out: horizontal standard deviation per axis in
metres.
"""

from __future__ import annotations

import math

BASE_STD_M = {
    1: 1.5,  # autonomous: data sheets of L1 receivers state 1.5 to 2.5 m CEP, and CEP = 1.18 sigma
    2: 0.8,  # differential or SBAS: 1.0 m CEP in the same data sheets
    3: 1.0,  # precise positioning service (military, two frequencies): no ionosphere, the rest as autonomous
    4: 0.02,  # RTK fixed: 1 cm + 1 ppm of the baseline stated; doubled for multipath on a car's roof
    5: 0.3,  # RTK float: decimetres while the ambiguities converge
    6: 10.0,  # dead reckoning: some per cent of the way since the last fix; this after a few hundred metres
    8: 1.5,  # signal simulator: emulates an autonomous receiver
}
"""One-sigma per axis at HDOP 1, by GGA quality."""

MIN_HDOP = 0.6
"""Receivers of many constellations report less, but multipath and atmosphere do not average out so well."""
MIN_STD_M = 0.01
"""The antenna's phase centre moves by this much with the satellites' elevation."""
MAX_STD_M = 100.0
GST_MAX_AGE_S = 5.0
_UNKNOWN_QUALITY_STD_M = 10.0


def position_std(quality: int, hdop: float, gst_std_m: float = math.nan) -> float:
    """Return horizontal one-sigma per axis (m), never NaN, within [MIN_STD_M, MAX_STD_M].

    `gst_std_m` is a fresh GST's root mean square over both axes; NaN or 0 (which receivers send for
    'unknown') falls back on the quality's base times HDOP, where a missing HDOP counts as 1.
    """
    if math.isfinite(gst_std_m) and gst_std_m > 0.0:
        std_m = gst_std_m
    else:
        dilution = max(hdop, MIN_HDOP) if math.isfinite(hdop) and hdop > 0.0 else 1.0
        std_m = BASE_STD_M.get(quality, _UNKNOWN_QUALITY_STD_M) * dilution
    return min(max(std_m, MIN_STD_M), MAX_STD_M)
