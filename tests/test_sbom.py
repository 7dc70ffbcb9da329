"""The software bill of materials names all that is shipped, as package indexes spell it."""

from __future__ import annotations

import re

from tests.conftest import REPO
from tools.make_sbom import bill


def test_the_bill_names_what_is_shipped_by_its_normalised_name() -> None:
    """Names are those of PEP 503; the charts' library is there with the version that its file states."""
    found = [
        ("tpmsd", "1", "MIT"),
        ("typing_extensions", "4", ""),
        ("Ruamel.Yaml__Clib", "1", ""),
        ("pip", "1", ""),
    ]
    purls = [one["purl"] for one in bill(found)["components"]]
    script = (REPO / "tpmsd" / "offline" / "report" / "assets" / "uPlot.iife.min.js").read_text("utf-8")
    (version,) = re.findall(r"v([0-9.]+)", script[:100])

    assert [
        "pkg:pypi/ruamel-yaml-clib@1",
        "pkg:pypi/typing-extensions@4",
        f"pkg:npm/uplot@{version}",
    ] == purls


def test_every_file_of_others_is_in_the_bill() -> None:
    """Each licence of a shipped file belongs to a component of the bill."""
    licences = {path.name.removeprefix("LICENSE.").lower() for path in REPO.glob("tpmsd/**/LICENSE.*")}

    assert licences <= {one["name"] for one in bill([("tpmsd", "1", "MIT")])["components"]}
    assert licences
