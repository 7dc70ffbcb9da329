"""Fewer points for the same picture.

In: series of one length. Out: the least and the greatest value of each bucket, so that no spike is lost
however far the view is zoomed out.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tpmsd.foundation.wheels import FloatArray


def decimated(
    x: FloatArray, columns: Mapping[str, FloatArray], points: int
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return x and columns, (n,) each, with at most `points` rows: minimum and maximum of each bucket.

    A bucket without a value stays NaN, so that gaps remain gaps.
    """
    n = len(x)
    buckets = max(points // 2, 1)
    if n <= 2 * buckets:
        return x, dict(columns)
    edges = np.linspace(0, n, buckets + 1).astype(np.intp)[:-1]
    middle = np.repeat(x[edges], 2)
    middle[1::2] = x[np.append(edges[1:], n) - 1]
    out = {}
    for name, values in columns.items():
        pair = np.empty(2 * buckets)
        pair[0::2] = np.fmin.reduceat(values, edges)
        pair[1::2] = np.fmax.reduceat(values, edges)
        out[name] = pair
    return middle, out
