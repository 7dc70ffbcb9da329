"""`tpmsd.discover`: equal to the command, from a folder and from memory."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import tpmsd
from tests.interfaces.api.conftest import FAULT
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.main import main


def test_a_discovery_equals_the_command(folder: Path, tmp_path: Path) -> None:
    """`to_dict()` is the JSON of `tpmsd discover`; a drive in memory gives the same roles."""
    file = tmp_path / "discover.json"
    code = main(["discover", str(folder), "--json", str(file)])
    found = tpmsd.discover(folder)

    assert json.loads(file.read_text()) == json.loads(json.dumps(found.to_dict()))
    assert (0 if found.wheels_decided else 4) == code
    assert {f"wheel_count_{wheel}" for wheel in WHEELS} <= set(found.roles)
    in_memory = tpmsd.discover(tpmsd.simulate(duration_s=160.0, seed=3, faults=(FAULT,)))
    shown = [{role: one.field.signal for role, one in each.roles.items()} for each in (found, in_memory)]
    assert shown[0] == shown[1]
    assert list(found.roles) == list(found.to_pandas()["role"])
    axes = Figure().subplots()
    assert axes is found.plot(axes)
    assert "wheel_count_rl" in found._repr_html_()
    assert "[can.signals]" in found.vehicle_toml()


def test_wrong_use_of_discover_is_reported(folder: Path) -> None:
    """A size that is none, and a folder that is not there, are told in one line."""
    with pytest.raises(tpmsd.ConfigError, match="not a tyre's size"):
        tpmsd.discover(folder, tyre="round")
    with pytest.raises(tpmsd.InputError, match="no such"):
        tpmsd.discover("nowhere")
