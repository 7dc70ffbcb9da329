"""Report which compiled kernels this installation can load: hypothesis bank, whitening gains, candump lines,
comparison of hypotheses.

In: the installed files. Out: one word per kernel and for all of them. Each kernel has a twin in NumPy that
gives the same results within rounding and runs where the compiled one is absent.
"""

from __future__ import annotations

from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

FILES = {
    "bank": "onboard/estimators/bank/_bank",
    "gains": "offline/inference/_gains",
    "candump": "onboard/sources/can/_candump",
    "evidence": "onboard/monitor/evidence/_evidence",
}
"""Kernel -> its file below the package's folder, without the suffix."""
COMPILED, NUMPY = "compiled", "numpy"


def loadable(stem: Path) -> bool:
    """Return whether an extension module of this path, without its suffix, can be loaded on this machine."""
    for suffix in EXTENSION_SUFFIXES:
        file = stem.with_name(stem.name + suffix)
        spec = spec_from_file_location(stem.name, file) if file.is_file() else None
        if spec is None:
            continue
        try:
            module_from_spec(spec)
        except ImportError:  # made for another processor or C library
            continue
        return True
    return False


@cache
def kernels() -> dict[str, bool]:
    """Return a mapping kernel -> whether its compiled form can be loaded."""
    package = Path(__file__).resolve().parents[1]
    return {name: loadable(package / file) for name, file in FILES.items()}


def kernel() -> str:
    """Return `compiled`, `numpy`, or `compiled: bank, gains` where only these are."""
    found = [name for name, there in kernels().items() if there]
    if len(found) == len(FILES):
        return COMPILED
    return f"{COMPILED}: {', '.join(found)}" if found else NUMPY
