"""Prints the software bill of materials of an environment (CycloneDX 1.5): packages, versions, licences.

In: the path of the environment's Python. Out: JSON on standard output, in the order of the names.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

ASK = """
import json, importlib.metadata as m
def licence(d):
    return d.metadata.get("License-Expression") or d.metadata.get("License") or ""
print(json.dumps([(d.metadata["Name"], d.version, licence(d)) for d in m.distributions()]))
"""
NOT_SHIPPED = {"pip", "setuptools", "wheel"}
ASSETS = Path(__file__).resolve().parent.parent / "tpmsd" / "offline" / "report" / "assets"


def bill(found: list[tuple[str, str, str]]) -> dict[str, Any]:
    """The document; `found`: name, version and licence of each package."""
    packages = sorted(
        (re.sub(r"[-_.]+", "-", name).lower(), version, licence) for name, version, licence in found
    )
    (own,) = [each for each in packages if each[0] == "tpmsd"]
    others = [each for each in packages if each[0] not in {"tpmsd", *NOT_SHIPPED}]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": _component(own, "application")},
        "components": [*(_component(each, "library") for each in others), uplot()],
    }


def uplot(assets: Path = ASSETS) -> dict[str, Any]:
    """The library of the pages' charts, which is shipped as a file; its version is in its first line."""
    first = (assets / "uPlot.iife.min.js").read_text("utf-8").splitlines()[0]
    (version,) = re.findall(r"uPlot \(v([0-9.]+)\)", first)
    return {
        "type": "library",
        "name": "uplot",
        "version": version,
        "purl": f"pkg:npm/uplot@{version}",
        "licenses": [{"license": {"name": "MIT"}}],
    }


def _component(package: tuple[str, str, str], kind: str) -> dict[str, Any]:
    name, version, licence = package
    first = licence.strip().splitlines()[0][:80] if licence.strip() else ""
    stated = {"licenses": [{"license": {"name": first}}]} if first else {}
    return {"type": kind, "name": name, "version": version, "purl": f"pkg:pypi/{name}@{version}", **stated}


if __name__ == "__main__":
    answer = subprocess.run([sys.argv[1], "-I", "-c", ASK], capture_output=True, text=True, check=True)
    print(json.dumps(bill([tuple(each) for each in json.loads(answer.stdout)]), indent=2))
