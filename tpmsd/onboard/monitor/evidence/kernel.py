"""Compiled arithmetic of the comparison of hypotheses (`_evidence.c`).

In: nothing. Out: the module `compiled`; None where it is absent or of other sources. Each function of it has
a reference of NumPy arrays beside the place that calls it.
"""

from __future__ import annotations

from typing import Any

from tpmsd.foundation.kernels import loaded

__all__ = ["compiled"]

compiled: Any = loaded("evidence")
