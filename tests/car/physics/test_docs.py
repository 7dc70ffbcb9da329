"""What the documents say about effects, models and adapters is what the program does."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tpmsd.car.physics.catalogue import EFFECTS, parse_effect, sentence_of
from tpmsd.car.physics.covariates import COVARIATES
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.model_file import parse_model
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.report.effects_reference import effects_page
from tpmsd.onboard.sources.can import log as can_log

REPO = Path(__file__).resolve().parents[3]
TEXT = (REPO / "docs" / "explanation" / "physics.md").read_text(encoding="utf-8")
CONTRIBUTING = (REPO / "CONTRIBUTING.md").read_text(encoding="utf-8")


def block(language: str, text: str = TEXT, within: str = "") -> str:
    """The first block of this language that holds `within`."""
    found = [each for each in re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL) if within in each]
    return str(found[0])


def test_the_reference_page_is_the_catalogue() -> None:
    """docs/reference/effects.md is what `tpmsd effects --markdown` prints, with every parameter."""
    page = (REPO / "docs" / "reference" / "effects.md").read_text(encoding="utf-8")

    assert effects_page() == page
    for name, effect in EFFECTS.items():
        (row,) = (line for line in page.splitlines() if line.startswith(f"| `{name}` |"))
        assert [] == [p.name for p in effect.parameters if f"`{p.name}`" not in row]


def test_the_table_of_hooks_is_complete() -> None:
    """Every hook of the base class is explained."""
    hooks = [name for name, value in vars(Effect).items() if callable(value) and not name.startswith("_")]

    assert [] == [
        hook for hook in hooks if hook not in ("values", "unit_of") and f"| `{hook}(" not in CONTRIBUTING
    ]


AS_A_FILE = """
import sys
import tpmsd.car.physics.effects as effects
effects.__path__.append(sys.argv[1])
from tests.car.physics.motions import car, steady
from tpmsd.interfaces.cli.main import main
from tpmsd.car.physics.catalogue import make_effect
change = make_effect("aerodynamic_lift", area_m2=0.2).radius_change_m(steady(30.0), car())[0]
print("by hand:", [float(f"{value:.3g}") for value in change])
drive = sys.argv[2] + "/spoiler"
effect = "aerodynamic_lift:area_m2=1.5"
assert 0 == main(["simulate", drive, "--duration", "400", "--flat", "--effect", effect])
assert 0 == main(["diagnose", drive, "--model-out", sys.argv[2] + "/model.toml"])
"""


def test_the_example_of_an_effect_is_all_it_takes(tmp_path: Path) -> None:
    """The text as printed, saved as one more file of the catalogue, is simulated, diagnosed and named."""
    (tmp_path / "catalogue").mkdir()
    (tmp_path / "catalogue" / "aerodynamic_lift.py").write_text(
        block("python", CONTRIBUTING, "class AerodynamicLift"), encoding="utf-8"
    )
    arguments = [sys.executable, "-c", AS_A_FILE, str(tmp_path / "catalogue"), str(tmp_path)]
    done = subprocess.run(arguments, capture_output=True, text=True, cwd=REPO, timeout=300)

    assert 0 == done.returncode, done.stderr
    # 0.25 mm per 500 N, 0.5 * 1.2 * 0.2 * 30^2 = 108 N on the axle, 54 N per wheel: 0.027 mm.
    assert "by hand: [0.0, 0.0, 2.7e-05, 2.7e-05]" in done.stdout
    found = re.search(r"1\. aerodynamic_lift .*: the air lifts the tail.*\n +area_m2 = (\S+) ", done.stdout)
    assert found is not None, done.stdout
    assert float(found[1]) == pytest.approx(1.5, abs=0.3)
    assert "aerodynamic_lift" in (tmp_path / "model.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_effect_names_its_source_and_speaks_to_the_reader(name: str) -> None:
    """A source in the docstring, a sentence for reports, and a place where it shows."""
    assert re.search(r"Source: .{10,}", EFFECTS[name].__doc__ or "", re.DOTALL)
    assert len(sentence_of(name).split()) > 4
    assert EFFECTS[name].identification.shows_in[1] in {*COVARIATES, "wheel_angle"}


def test_the_example_of_a_model_file_is_one() -> None:
    """The TOML as printed loads, standard deviation and all."""
    model = parse_model(block("toml"))

    assert ["centrifugal_growth", "road_grade"] == [effect.name for effect in model]
    assert {"coefficient": 1e-7} == model.stds[0]


def test_the_error_that_is_shown_is_the_error_that_comes() -> None:
    """The line under the refused command is the message."""
    shown = re.search(r"--effect (\S+)\ntpmsd: (.*)\n", TEXT)
    assert shown is not None
    with pytest.raises(ConfigError) as caught:
        parse_effect(shown[1])

    assert shown[2] == str(caught.value)


def test_the_example_of_an_adapter_is_all_it_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The text as printed, as one more row of the readers, reads frames and names the line that is none."""
    names: dict[str, Any] = {}
    exec(block("python", CONTRIBUTING, "def read_semicolons"), names)
    monkeypatch.setitem(can_log.READERS, ".scan", names["read_semicolons"])
    (tmp_path / "can.scan").write_text("1.5;0B0;1122\n1.6;0B0;zz\n1.75;18FEF4C8;\n", encoding="ascii")
    bad: list[int] = []

    frames = list(can_log.read_can_log(can_log.find_can_log(tmp_path), lambda line, _: bad.append(line)))

    assert [(1.5, 0x0B0, False, b"\x11\x22", 1), (1.75, 0x18FEF4C8, True, b"", 3)] == [
        (frame.time_s, frame.arbitration_id, frame.is_extended, frame.data, frame.line) for frame in frames
    ]
    assert [2] == bad
