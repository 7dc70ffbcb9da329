"""Write the packages of the container with their hashes, for x86_64 and aarch64.

In: the extras that the container installs. Out: `requirements.txt` with one version of each package and the
SHA-256 of each wheel that may be taken, for `pip install --require-hashes`. Wheels alone: nothing of theirs
is run while they are installed. Needs the network; run it where a dependency is to be renewed, and read the
difference.

    python tools/make_lock.py > contrib/container/requirements.txt
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

REPO = Path(__file__).resolve().parents[1]
EXTRAS = ("mqtt", "prometheus")
PYTHON = "3.11"
PROCESSORS = ("x86_64", "aarch64")
GLIBC = range(17, 37)
"""Minor versions of glibc 2 whose wheels run on Debian 12 (2.36)."""


def wanted(extras: tuple[str, ...]) -> list[str]:
    """Return the requirements of the program with these extras, and of its build."""
    document = tomllib.loads((REPO / "pyproject.toml").read_text("utf-8"))
    project = document["project"]
    optional = [each for extra in extras for each in project["optional-dependencies"][extra]]
    return [*project["dependencies"], *optional, *document["build-system"]["requires"], "wheel"]


def resolved(requirements: list[str], processor: str) -> dict[str, tuple[str, str]]:
    """Return version and SHA-256 of each package's wheel for a processor, by name."""
    platforms = [f"manylinux_2_{minor}_{processor}" for minor in GLIBC] + [f"manylinux2014_{processor}"]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--ignore-installed"]
        command += ["--report", "-", "--target", folder, "--only-binary=:all:", "--python-version", PYTHON]
        command += [part for platform in platforms for part in ("--platform", platform)]
        done = subprocess.run([*command, *requirements], capture_output=True, text=True, check=True)
    found = {}
    for one in json.loads(done.stdout)["install"]:
        name = re.sub(r"[-_.]+", "-", one["metadata"]["name"]).lower()
        found[name] = (one["metadata"]["version"], one["download_info"]["archive_info"]["hashes"]["sha256"])
    return found


def lock(by_processor: list[dict[str, tuple[str, str]]]) -> str:
    """Return the text of the file; ValueError where processors resolve to different versions."""
    lines = []
    for name in sorted(set().union(*by_processor)):
        versions = {found[name][0] for found in by_processor if name in found}
        if len(versions) > 1:
            raise ValueError(f"{name}: {' and '.join(sorted(versions))}")
        hashes = sorted({found[name][1] for found in by_processor if name in found})
        lines.append(" \\\n    ".join([f"{name}=={versions.pop()}", *(f"--hash=sha256:{h}" for h in hashes)]))
    return "\n".join(["# Made by tools/make_lock.py; renewed by the same command.", *lines]) + "\n"


def main() -> int:
    """Print the file."""
    parser = argparse.ArgumentParser(description="lock the container's packages with hashes")
    parser.parse_args()
    requirements = wanted(EXTRAS)
    try:
        print(lock([resolved(requirements, processor) for processor in PROCESSORS]), end="")
    except subprocess.CalledProcessError as error:
        print((error.stderr.strip().splitlines() or [str(error)])[-1], file=sys.stderr)
        return 1
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
