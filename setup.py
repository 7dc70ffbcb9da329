"""The parts of tpmsd that may be compiled: the arithmetic of the Gaussian-sum filter's hypothesis bank, the
gains of the diagnosis' whitening filter, lines of candump, NMEA sentences, and the monitor's comparison of
hypotheses.

Everything else of the build is in pyproject.toml. Without a compiler or Python's headers the extensions are
left out, and the same is done with NumPy arrays. TPMSD_NO_KERNEL=1 leaves them out on purpose, for the wheel
that fits every machine. TPMSD_WHEEL_PLATFORM names the platform of a wheel that is compiled for another
machine than this one (`tools/make_wheels.py`): there a kernel that does not compile is an error.
"""

from __future__ import annotations

import os
import runpy
from pathlib import Path

from setuptools import Extension, setup

PLATFORM = os.environ.get("TPMSD_WHEEL_PLATFORM", "")

PACKAGE = Path(__file__).resolve().parent / "tpmsd"
SHARED = runpy.run_path(str(PACKAGE / "foundation" / "kernels.py"))
KERNELS = [
    Extension(
        f"tpmsd.{file.replace('/', '.')}",
        sources=[f"tpmsd/{file}.c"],
        depends=[f"tpmsd/{header}" for header in SHARED["HEADERS"]],
        define_macros=[("TPMSD_SOURCES", str(SHARED["sources_number"](PACKAGE, name)))],
        # Results are the same on every machine: no fused multiply-add. No paths of the build in the file.
        extra_compile_args=["-O3", "-ffp-contract=off", "-fno-math-errno", "-g0"],
        extra_link_args=["-Wl,-s"],
        libraries=["m"],
        py_limited_api=True,
        optional=not PLATFORM,
    )
    for name, file in SHARED["FILES"].items()
]
LEFT_OUT = os.environ.get("TPMSD_NO_KERNEL", "") not in ("", "0")
WHEEL = {"py_limited_api": "cp311"} | ({"plat_name": PLATFORM} if PLATFORM else {})

setup(
    ext_modules=[] if LEFT_OUT else KERNELS,
    options={} if LEFT_OUT else {"bdist_wheel": WHEEL},
)
