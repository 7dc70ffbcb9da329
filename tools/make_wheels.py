"""Build the published wheels: compiled for each processor, and a pure one for every other machine.

In: a folder with the sources, a folder for the wheels. Out: `cp311-abi3-manylinux_2_17` wheels for x86_64
and aarch64, and the wheel without kernels. The compiler is Zig's clang (package `ziglang`): it brings the
headers and the symbol versions of glibc 2.17 for both processors, so that no image and no other machine is
needed. auditwheel then checks that each compiled wheel keeps to its platform. The same sources make the same
bytes (SOURCE_DATE_EPOCH).
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

GLIBC = "2.17"
"""manylinux2014: Debian 8, Ubuntu 14.04, RHEL 7 and everything later."""
PROCESSORS = ("x86_64", "aarch64")
KERNELS = ("_bank.abi3.so", "_gains.abi3.so", "_candump.abi3.so", "_nmea.abi3.so", "_evidence.abi3.so")


class WheelError(Exception):
    """A wheel cannot be built or is not what it should be; the message says why."""


def compiler(processor: str) -> list[str]:
    """Command of the cross compiler; without the sanitizer that Zig switches on by itself."""
    target = f"{processor}-linux-gnu.{GLIBC}"
    return [sys.executable, "-m", "ziglang", "cc", "-target", target, "-fno-sanitize=undefined"]


def build(sources: Path, out: Path, environment: dict[str, str]) -> Path:
    """Build one wheel of the sources; return its path.

    Raises WheelError: with the end of the build's output.
    """
    before = set(out.glob("*.whl"))
    command = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(out), "."]
    done = subprocess.run(
        command, cwd=sources, env={**os.environ, **environment}, capture_output=True, text=True
    )
    new = set(out.glob("*.whl")) - before
    if done.returncode != 0 or len(new) != 1:
        raise WheelError("\n".join((done.stdout + done.stderr).splitlines()[-15:]))
    shutil.rmtree(sources / "build", ignore_errors=True)  # compiled for this processor alone
    return new.pop()


def build_compiled(sources: Path, out: Path, processor: str) -> Path:
    """Build the wheel with kernels for one processor; return its path.

    Raises WheelError: it does not compile, lacks a kernel, or needs more than its platform promises.
    """
    platform = f"manylinux_{GLIBC.replace('.', '_')}_{processor}"
    compile_ = compiler(processor)
    wheel = build(
        sources,
        out,
        {
            "TPMSD_WHEEL_PLATFORM": platform,
            "CC": " ".join(compile_),
            "LDSHARED": " ".join([*compile_, "-shared"]),
            "_PYTHON_HOST_PLATFORM": f"linux-{processor}",
        },
    )
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    missing = [kernel for kernel in KERNELS if not any(name.endswith(f"/{kernel}") for name in names)]
    if missing:
        raise WheelError(f"{wheel.name} lacks {', '.join(missing)}")
    audit = [sys.executable, "-m", "auditwheel", "show", str(wheel)]
    shown = subprocess.run(audit, capture_output=True, text=True)
    if shown.returncode != 0 or f'"{platform}"' not in shown.stdout:
        raise WheelError(f"{wheel.name}: auditwheel says {(shown.stdout + shown.stderr).strip()}")
    return wheel


def main() -> int:
    """Build all wheels and print their names; 1 with the reason if one fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("sources", type=Path, help="folder with pyproject.toml")
    parser.add_argument("out", type=Path, help="folder for the wheels")
    args = parser.parse_args()
    try:
        for processor in PROCESSORS:
            print(build_compiled(args.sources, args.out, processor).name)
        print(build(args.sources, args.out, {"TPMSD_NO_KERNEL": "1"}).name)
    except WheelError as error:
        print(f"make_wheels: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
