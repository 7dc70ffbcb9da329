"""Compiled arithmetic of the comparison of hypotheses (`_evidence.c`).

In: nothing. Out: the module `compiled`; None where it was not built, or of older sources. Each function of it
has a reference of NumPy arrays beside the place that calls it.
"""

from __future__ import annotations

from types import ModuleType

__all__ = ["compiled"]

try:
    from tpmsd.onboard.monitor.evidence import _evidence as compiled
except ImportError:  # there was no compiler, or it was left out
    compiled: ModuleType | None = None  # type: ignore[no-redef]

if not hasattr(compiled, "first"):
    compiled = None  # type: ignore[assignment]
