"""Load compiled kernels, and report which of them this installation has: hypothesis bank, whitening gains,
candump lines, NMEA sentences, comparison of hypotheses.

In: the installed files. Out: modules, one word for all kernels. Each kernel has a twin in NumPy that gives
the same results within rounding and runs where the compiled one is absent, or was built of other sources than
those beside it: its functions may take other arguments then. `setup.py` runs this file by itself: it imports
the standard library alone.
"""

from __future__ import annotations

import logging
import re
import sys
import zlib
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

FILES = {
    "bank": "onboard/estimators/bank/_bank",
    "gains": "offline/inference/_gains",
    "candump": "onboard/sources/can/_candump",
    "nmea": "onboard/sources/gnss/_nmea",
    "evidence": "onboard/monitor/evidence/_evidence",
}
"""Kernel -> its file below the package's folder, without the suffix."""
HEADERS = ("foundation/_arrays.h", "foundation/_sources.h")
"""Headers of the kernels, below the package's folder."""
COMPILED, NUMPY = "compiled", "numpy"
_COMMENT = re.compile(rb"/\*.*?\*/", re.DOTALL)
_SPACES = b" \t\n\r\f\v"


def sources_number(package: Path, name: str) -> int | None:
    """Return a CRC-32 of a kernel's C code without comments and spaces; None where a file of it is missing,
    as in an installed wheel, whose kernels were built with it."""
    files = [package / f"{FILES[name]}.c", *(package / header for header in HEADERS)]
    try:
        code = b"".join(_COMMENT.sub(b"", file.read_bytes()) for file in files).translate(None, _SPACES)
    except OSError:
        return None
    return zlib.crc32(code) & 0x7FFFFFFF  # a C long has 32 bits on some machines, one of them a sign


def load_module(package: Path, name: str) -> ModuleType | None:
    """Return the compiled module of a kernel, whatever its sources; None where none can be loaded."""
    stem, dotted = package / FILES[name], f"{package.name}.{FILES[name].replace('/', '.')}"
    for suffix in EXTENSION_SUFFIXES:
        file = stem.with_name(stem.name + suffix)
        spec = spec_from_file_location(dotted, file) if file.is_file() else None
        if spec is None or spec.loader is None:
            continue
        try:
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
        except ImportError:  # made for another processor or C library
            continue
        return module
    return None


def is_outdated(package: Path, name: str, module: ModuleType | None) -> bool:
    """Return whether a compiled module was built of other sources than those in the package."""
    number = sources_number(package, name)
    return module is not None and number is not None and getattr(module, "SOURCES", None) != number


@cache
def _installed(name: str) -> tuple[ModuleType | None, bool]:
    """Return the compiled module of a kernel of this installation, and whether it is outdated."""
    module = load_module(_PACKAGE, name)
    return module, is_outdated(_PACKAGE, name, module)


@cache
def loaded(name: str) -> ModuleType | None:
    """Return the compiled module of a kernel; None where it is absent or outdated. One warning names all
    outdated ones."""
    module, is_old = _installed(name)
    if not is_old:
        if module is not None:
            sys.modules.setdefault(module.__name__, module)  # pickle looks for its functions there
        return module
    _warn_outdated()
    return None


@cache
def kernels() -> dict[str, bool]:
    """Return kernel -> whether its compiled form can be loaded and is of the present sources."""
    modules = {name: _installed(name) for name in FILES}
    return {name: module is not None and not is_old for name, (module, is_old) in modules.items()}


@cache
def outdated() -> tuple[str, ...]:
    """Return the kernels whose compiled form was built of other sources."""
    return tuple(name for name in FILES if _installed(name)[1])


def kernel() -> str:
    """Return which kernels run, in words: `compiled`, `numpy`, or `compiled: bank, gains` where only these
    are; ` (outdated: candump)` is added where a kernel was built of other sources."""
    able = [name for name, there in kernels().items() if there]
    old = outdated()
    if len(able) == len(FILES):
        return COMPILED
    word = f"{COMPILED}: {', '.join(able)}" if able else NUMPY
    return f"{word} (outdated: {', '.join(old)})" if old else word


@cache
def _warn_outdated() -> None:
    """Log once which kernels are outdated and how to build them again."""
    logging.getLogger("tpmsd").warning(
        "tpmsd: compiled kernels of other sources are left out (%s), and NumPy runs, slower; "
        "build them again: python setup.py build_ext --inplace",
        ", ".join(outdated()),
    )


_PACKAGE = Path(__file__).resolve().parents[1]
