"""The one command line of the benchmarks."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bench import registry
from bench.cli import main, parse


def test_the_list_names_every_campaign(capsys: pytest.CaptureFixture[str]) -> None:
    """A line each, by name and summary."""
    assert 0 == main(["list"])
    lines = capsys.readouterr().out.splitlines()

    assert [line.split()[0] for line in lines] == list(registry.CAMPAIGNS)


@pytest.mark.parametrize("name", sorted(registry.CAMPAIGNS))
def test_every_campaign_is_there_and_takes_its_own_options(name: str) -> None:
    """Its module is found, and it is the one that is asked for."""
    needed = {name: ["DRIVE"] for name in ("independent-look", "injected", "vehicle-state-drive")}

    assert name == parse(["run", name, *needed.get(name, [])]).name


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["run", "phlogiston"], "invalid choice: 'phlogiston'"),
        (["run", "slip-gate", "--minutes", "1"], "a drive must be longer than two minutes"),
        (["run", "speed", "--runs", "0"], "at least one run"),
        (
            ["run", "dynamics-cars", "--kinds", "single", "--baseline", "three-dof"],
            "no drive is of these kinds, baseline and names; there are null with single-track",
        ),
    ],
)
def test_wrong_usage_is_reported_in_one_line(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, the reason on the last line."""
    with pytest.raises(SystemExit) as end:
        main(words)

    assert 2 == end.value.code
    assert told in capsys.readouterr().err.splitlines()[-1]


def test_a_result_is_written_as_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the campaign gives back stands in the file; an exit code is passed on."""
    campaign = registry.CAMPAIGNS["decode"]
    monkeypatch.setattr("bench.campaigns.onboard.decode.main", lambda args: {"rate": 7.0})

    assert 0 == main(["run", campaign.name, "--json", str(tmp_path / "x.json")])
    assert {"rate": 7.0} == json.loads((tmp_path / "x.json").read_text())

    monkeypatch.setattr("bench.campaigns.onboard.decode.main", lambda args: 3)
    assert 3 == main(["run", campaign.name])
