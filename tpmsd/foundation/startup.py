"""Start-up and run time kept short: modules imported on demand, cycle collection and freed memory controlled.

In: nothing. Out: nothing; import system, collector or allocator are set. python-can imports asammdf
wherever that is installed, and asammdf pandas: a second and 90 MB, of which only MF4 files make use. cantools
imports python-can for its test bench, and SciPy asks NumPy for everything that it has.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import importlib
import importlib.abc
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType


class _ImportBlocker(importlib.abc.MetaPathFinder):
    """Lets asammdf look as if it were not installed."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname == "asammdf":
            raise ModuleNotFoundError(f"{fullname} is left out until a file needs it", name=fullname)
        return None


def leave_out_mf4() -> None:
    """Import python-can without its reader of MF4 files from now on; one call is enough."""
    if not any(isinstance(finder, _ImportBlocker) for finder in sys.meta_path):
        sys.meta_path.insert(0, _ImportBlocker())


class _WithoutOpenSsl(importlib.abc.MetaPathFinder):
    """Lets Python look as if it were built without OpenSSL."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname in ("_hashlib", "_ssl"):
            raise ModuleNotFoundError(f"{fullname} is left out", name=fullname)
        return None


_OWN_HASHES = frozenset({"_md5", "_sha1", "_sha3", "_blake2"})
_OWN_SHA2 = (frozenset({"_sha256", "_sha512"}), frozenset({"_sha2"}))
"""Hashes that Python brings itself; those of SHA-2 by its version."""


@contextmanager
def without_openssl() -> Iterator[None]:
    """Import hashlib and asyncio without OpenSSL, of which the daemon uses nothing and which takes 4.5 MB;
    ssl can be imported afterwards. Does nothing where Python has no hashes of its own.
    """
    own = {name for name in _OWN_HASHES.union(*_OWN_SHA2) if importlib.util.find_spec(name) is not None}
    if not (own >= _OWN_HASHES and any(own >= names for names in _OWN_SHA2)):
        yield
        return
    finder = _WithoutOpenSsl()
    sys.meta_path.insert(0, finder)
    try:
        importlib.import_module("secrets")  # of which NumPy's generators make use, later
        yield
    finally:
        sys.meta_path.remove(finder)


ON_DEMAND = frozenset(
    {
        *("cantools.logreader", "cantools.tester", "scipy.spatial"),
        *("numpy.ctypeslib", "numpy.f2py", "numpy.polynomial", "numpy.testing"),
    }
)
"""Modules that packages in use import whole and of which no command needs more than the name."""


class _OnDemand(importlib.abc.MetaPathFinder):
    """Runs these modules where something of theirs is first used, not where they are imported."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in ON_DEMAND:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = importlib.util.LazyLoader(spec.loader)
        return spec


def import_on_demand() -> None:
    """Run the modules of `ON_DEMAND` when they are first used; one call is enough."""
    if not any(isinstance(finder, _OnDemand) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OnDemand())


def bring_in_mf4() -> None:
    """Import asammdf after all, and python-can's reader with it; ImportError where it is not installed."""
    left_out = [finder for finder in sys.meta_path if isinstance(finder, _ImportBlocker)]
    for finder in left_out:
        sys.meta_path.remove(finder)
    importlib.import_module("asammdf")
    reader = sys.modules.get("can.io.mf4")
    if left_out and reader is not None:
        importlib.reload(reader)


_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1
"""Parameters of glibc's `mallopt` (malloc.h)."""
_KEPT_BYTES = 1 << 29


def keep_freed_memory() -> None:
    """Keep freed memory in the process for the next array of its size: to ask the system for fresh pages each
    time takes a tenth of a diagnosis. Does nothing where the C library is not glibc.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _KEPT_BYTES)
        mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)


@contextmanager
def no_collection() -> Iterator[None]:
    """Switch the collection of cycles off while a drive is read or modules are imported: a million records
    are made, none of which is in a cycle, and the search takes a tenth of the time."""
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()


def freeze_imported_objects() -> None:
    """Exclude all that is imported, and what is there when the process ends, from the collection of cycles:
    to search it takes a quarter of a second of a command, and hardly any of it is in a cycle."""
    gc.freeze()
    atexit.register(gc.freeze)


_BLAS_SIZE = 128
"""Rows of matrices that are too large for BLAS's kernels without a work space."""


def reserve_linear_algebra() -> None:
    """Make BLAS allocate its work space now: OpenBLAS ends the process where it gets none at a later first
    use."""
    import numpy as np

    square = np.eye(_BLAS_SIZE)
    np.linalg.cholesky(square @ square)
