"""Effects that users bring: from a folder, an entry point, a configuration; and what is wrong with them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import astuple, replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.worlds.folder import write_folder
from bench.worlds.instruments import observe
from bench.worlds.kinematic import Spec, course
from tests.conftest import REPO
from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.car.physics.effect import Confounding, Effect, NoiseResemblance, Wording
from tpmsd.car.physics.effects.brake_slip import BrakeSlip
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.motion import Car
from tpmsd.car.physics.own_effects import (
    effects_of_entry_point,
    effects_of_file,
    external_effects,
    files_of,
    use_folder,
)
from tpmsd.foundation.errors import ConfigError

GOOD = '''"""A tyre that sinks in, in bends of either side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter, Prior
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class BendSinking(Effect):
    """The front right tyre becomes smaller in bends of either side.

    Source: made up for a test.
    """

    name = "bend_sinking"
    formula = "delta_r = -c * abs(a_y) on fr"
    shows_in = ("wheel_ratio", "accel_lat")
    parameters = (
        Parameter(
            "coefficient", "s2", 2e-4, -1e-2, 1e-2, "c", probe=1e-5, prior=Prior(0.0, 2e-4, "a test")
        ),
    )
    coefficient: float

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) on the front right wheel."""
        return -self.coefficient * np.abs(motion.accel_lat_mps2)[:, None] * np.array([0.0, 1.0, 0.0, 0.0])
'''
SURPLUS = 6e-4
"""By which the wheel turns more per m/s2 in the world below; its radius is 0.31 m."""


def tpmsd(*words: str | Path, code: int = 0, **environment: str) -> str:
    """What a run of the command prints, its errors included; a process of its own, which ends with it."""
    done = subprocess.run(
        [sys.executable, "-m", "tpmsd", *map(str, words)],
        cwd=REPO,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert code == done.returncode, done.stderr
    return done.stdout + done.stderr


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the effect, and a file that is none of its own."""
    own = tmp_path / "own"
    own.mkdir(mode=0o755)
    (own / "bend_sinking.py").write_text(GOOD)
    (own / "_helpers.py").write_text("raise RuntimeError")
    (own / "notes.txt").write_text("none")
    return own


def written(folder: Path, text: str) -> Path:
    """A file of that text."""
    path = folder / "mine.py"
    path.write_text(text)
    return path


def test_the_effects_of_a_folder_are_found(folder: Path) -> None:
    """Files of Python whose name begins with a letter, each read once."""
    (path,) = files_of(folder)
    (effect,) = effects_of_file(path)

    assert "bend_sinking" == effect.name
    assert [effect] == effects_of_file(path)


def test_a_world_in_which_it_acts_is_diagnosed_by_its_name(folder: Path, tmp_path: Path) -> None:
    """A drive of an independent world: by option, its value within three deviations; without it, unknown."""
    spec = Spec(duration_s=300.0, road="mixed", driven="front", stops=True)
    rng = np.random.default_rng(11)
    way = course(spec, rng)
    spin = SURPLUS * np.abs(way.a_lat)[:, None] * np.array([0.0, 1.0, 0.0, 0.0])
    write_folder(observe(replace(way, spin=spin), spec, rng, 11), tmp_path / "drive")
    report = tmp_path / "report.json"
    words = ["diagnose", tmp_path / "drive", "--certify", "0", "--json", report]

    def first() -> dict[str, Any]:
        finding: dict[str, Any] = json.loads(report.read_text())["findings"][0]
        return finding

    tpmsd(*words, "--effects-path", folder)
    value = first()["parameters"]["coefficient"]
    assert "bend_sinking" == first()["effect"]
    assert abs(value["value"] - SURPLUS * spec.radius_m) < 3.0 * value["std"]
    tpmsd(*words)
    assert "bend_sinking" != first()["effect"]


def test_every_command_knows_it(folder: Path, tmp_path: Path) -> None:
    """It is listed, simulated, compensated, and planned for; by the variable, too."""
    option = ("--effects-path", folder)
    assert "bend_sinking" in tpmsd("effects", *option)
    assert "delta_r = -c * abs(a_y) on fr" in tpmsd("effects", "bend_sinking", TPMSD_EFFECTS_PATH=str(folder))
    drive = tmp_path / "drive"
    effect = ("--effect", "bend_sinking:coefficient=3e-4")
    assert "bend_sinking: coefficient = 0.0003" in tpmsd(
        "simulate", drive, "--duration", "30", *effect, *option
    )
    model = tmp_path / "model.toml"
    model.write_text('[[effect]]\nname = "bend_sinking"\ncoefficient = 3e-4\n')
    tpmsd("replay", drive, "--model", model, *option)
    assert "unknown effect 'bend_sinking'" in tpmsd("replay", drive, "--model", model, code=2)
    assert "bend_sinking" in tpmsd("plan", "bend_sinking", *option)


def test_a_configuration_names_the_folder_and_a_recording_does_not(folder: Path, tmp_path: Path) -> None:
    """`[physics] effects_path` of a file that is named is followed; in a drive folder it is not: it could be
    anybody's."""
    drive = tmp_path / "drive"
    tpmsd("simulate", drive, "--duration", "30")
    (drive / "vehicle.toml").write_text(
        (drive / "vehicle.toml").read_text() + '\n[physics]\neffects_path = "../own"\n'
    )
    model = tmp_path / "model.toml"
    model.write_text('[[effect]]\nname = "bend_sinking"\ncoefficient = 3e-4\n')

    tpmsd("replay", drive, "--model", model, "--config", drive / "vehicle.toml")
    said = tpmsd("replay", drive, "--model", model, code=2)
    assert "effects_path is not followed in a drive folder" in said
    assert "unknown effect 'bend_sinking'" in said


BROKEN = {
    "line 1: ": "def (:",
    "RuntimeError: no": "raise RuntimeError('no')",
    "SystemExit: 3": "raise SystemExit(3)",
    "GeneratorExit": "raise GeneratorExit",
    ": Mute": "class Mute(Exception):\n def __str__(self): raise ValueError\nraise Mute",
    "parameters are no tuple": GOOD.replace("parameters = (", "parameters = 1\n    former = ("),
    "ModuleNotFoundError": "import a_module_that_is_not_there",
    "defines no effect": "x = 1",
    "has no name": GOOD.replace('"bend_sinking"', '"Bend sinking"'),
    "not a frozen dataclass": GOOD.replace("@dataclass(frozen=True)", ""),
    "parameters and fields differ: coefficient size": GOOD.replace(
        "    coefficient: float", "    size: float"
    ),
    "radius_change_m: ValueError: has the shape (12,)": GOOD.replace(
        "[:, None] * np.array([0.0, 1.0, 0.0, 0.0])", ""
    ),
    "radius_change_m: ValueError: is no finite": GOOD.replace("-self.coefficient *", "np.nan *"),
    "radius_change_m: ZeroDivisionError": GOOD.replace("-self.coefficient *", "1 // 0 *"),
    "ramp is for effects of the program": GOOD.replace(
        "    coefficient: float", "    ramp = True\n    coefficient: float"
    ),
    "cannot be nuisance": GOOD.replace("    formula =", "    kind = Kind.NUISANCE\n    formula =").replace(
        "import Effect,", "import Effect, Kind,"
    ),
    "its values: ConfigError": GOOD.replace("2e-4, -1e-2", "2.0, -1e-2"),
}


@pytest.mark.parametrize("reason", BROKEN)
def test_a_broken_file_is_one_line_with_its_name(tmp_path: Path, reason: str) -> None:
    """Whatever is wrong: syntax, an error while it is read, marks, fields, shapes."""
    path = written(tmp_path, BROKEN[reason].replace("\\n", "\n"))

    with pytest.raises(ConfigError) as caught:
        effects_of_file(path)

    assert reason in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert 1 == len(str(caught.value).splitlines())


def test_a_broken_file_ends_a_command_with_its_line(tmp_path: Path) -> None:
    """Exit code 2, and no traceback; a folder that is not there as well."""
    tmp_path.chmod(0o755)
    path = written(tmp_path, "def (:")
    said = tpmsd("effects", "--effects-path", tmp_path, code=2)

    assert [f"tpmsd: {path}: line 1: invalid syntax"] == said.splitlines()
    path.unlink()
    os.mkfifo(path, 0o600)
    assert "not a file" in tpmsd("effects", "--effects-path", tmp_path, code=2)
    assert "no folder of effects" in tpmsd("effects", "--effects-path", tmp_path / "none", code=2)


def test_a_name_stands_for_one_effect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One of the catalogue's own names is refused."""
    tmp_path.chmod(0o755)
    written(tmp_path, GOOD.replace('"bend_sinking"', '"wear"'))
    monkeypatch.setenv("TPMSD_EFFECTS_PATH", str(tmp_path))

    with pytest.raises(ConfigError, match="there is another effect 'wear'"):
        list(external_effects(EFFECTS))


@pytest.mark.parametrize("which", ["file", "folder"])
def test_what_anybody_may_write_is_not_run(folder: Path, which: str) -> None:
    """Of folders and files alike: it is code, run with the rights of the program."""
    (folder / "bend_sinking.py" if which == "file" else folder).chmod(0o777)

    with pytest.raises(ConfigError, match="anybody may write to it: chmod o-w"):
        files_of(folder)


def test_entry_points_bring_classes_and_modules(monkeypatch: pytest.MonkeyPatch) -> None:
    """A class, a module with classes; what is neither, or is not there, is one line with its name."""

    def point(value: str) -> EntryPoint:
        return EntryPoint("mine", value, "tpmsd.effects")

    wear = "tpmsd.car.physics.effects.wheel_spin"
    for value in (wear, f"{wear}:WheelSpin"):
        with pytest.raises(ConfigError, match=r"entry point mine .*wheel_spin: span is for effects of the"):
            effects_of_entry_point(point(value))
    (known,) = effects_of_entry_point(point("tpmsd.car.physics.effects.wear:Wear"))
    assert EFFECTS["wear"] is known
    for value in ("json:dumps", "no_such_module_of_effects", "json"):
        with pytest.raises(ConfigError, match="entry point mine"):
            effects_of_entry_point(point(value))
    monkeypatch.setattr(
        "tpmsd.car.physics.own_effects.entry_points",
        lambda group: [point("tpmsd.car.physics.effects.wear:Wear")],
    )
    assert [EFFECTS["wear"]] == list(external_effects({}))
    assert [] == list(external_effects(EFFECTS))


def test_folders_that_are_named_twice_count_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The catalogue of this process takes the effect in, and a second call changes nothing."""
    monkeypatch.setenv("TPMSD_EFFECTS_PATH", "")
    try:
        for _ in range(2):
            use_folder(folder)
        assert str(folder.resolve()) == os.environ["TPMSD_EFFECTS_PATH"]
        assert "bend_sinking" in EFFECTS
    finally:
        EFFECTS.pop("bend_sinking", None)


def test_an_effect_may_be_written_with_flat_and_former_names() -> None:
    """Fields outside their records go into these; what a class does not give stays as its base has it."""
    flat = {
        "telling_drive": "brake twice",
        "places": ("fl", "fr"),
        "formula": "r = 0",
        "looks": NoiseResemblance.WHEEL,
    }
    old: type[Effect] = type("Old", (BrakeSlip,), {"name": "old", **flat})

    assert Wording("r = 0", *astuple(BrakeSlip.wording)[1:4], "brake twice") == old.wording
    assert replace(BrakeSlip.identification, wheel_patterns=("fl", "fr")) == old.identification
    assert replace(BrakeSlip.confounding, resembles=NoiseResemblance.WHEEL) == old.confounding
    assert BrakeSlip.nonlinear is old.nonlinear


FORMER = '''"""An effect with all names that were in use before."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Beside, Effect, Grid, Nonlinear, Parameter, Prior, Rivals


@dataclass(frozen=True)
class Former(Effect):
    """The front tyres shrink."""

    name = "former"
    parameters = (
        Parameter("c", "s2", 1e-4, -1e-2, 1e-2, "c", probe=1e-5, prior=Prior(0.0, 2e-4, "a test")),
        Parameter("lag_s", "s", 1.0, 0.1, 9.0, "lag"),
        Parameter("tail_s", "s", 1.0, 0.1, 9.0, "tail"),
    )
    one_sign = True
    rivals = Rivals(rare=True, beside=("wear",), beside_value=("load_static",))
    nonlinear = Nonlinear(
        grid=Grid(
            parameter="lag_s",
            values=(1.0, 2.0),
            middle=1.0,
            range=(0.1, 9.0),
            price=lambda lag: lag,
            step=2.0,
            second=Beside(parameter="tail_s", range=(0.1, 9.0), price=lambda tail: 2.0 * tail, step=2.0),
        )
    )
    c: float
    lag_s: float
    tail_s: float

    @classmethod
    def against(cls, value):
        return super().against(value) + (1.0 if cls.rivals.rare else 0.0)

    @classmethod
    def usual(cls, value, std, speeds):
        return super().usual(value, std, speeds) + "as always"

    @classmethod
    def completed_by(cls, car):
        return {**super().completed_by(car), "c": "d"}
'''


def test_an_effect_with_all_former_names_has_them_all_read(tmp_path: Path) -> None:
    """Its hooks are called by the present names, and may call those of the base by their former ones."""
    tmp_path.chmod(0o755)
    (tmp_path / "former.py").write_text(FORMER)
    (effect,) = effects_of_file(tmp_path / "former.py")
    grid = effect.nonlinear.grid

    assert effect.confounding == Confounding(
        rare=True, tested_jointly_with=("wear",), estimated_jointly_with=("load_static",)
    )
    assert grid is not None and grid.second is not None
    assert (3.0, 8.0) == (grid.penalty(3.0), grid.second.penalty(4.0))
    assert (5.0, 9.0) == (effect.penalty(1.0), effect.penalty(-1.0))
    assert "as always" == effect.tolerance_note(1.0, 0.1, speeds=False)
    assert {"c": "d"} == effect.summed_with(Car(np.full(4, 0.3), WheelPositions(1.5, 1.5, 2.6), np.zeros(4)))


def test_fields_of_a_record_may_be_given_flat_by_their_former_names() -> None:
    """`beside` and `beside_value` are in the record, and a mark by its former name is the mark."""
    flat = {"beside": ("wear",), "beside_value": ("load_static",), "alike_on_every_drive": True}
    old: type[Effect] = type("Old", (Effect,), {"name": "old", **flat})

    assert Confounding(False, False, NoiseResemblance.OTHER, ("wear",), ("load_static",)) == old.confounding
    assert old.common_to_all_drives


def test_an_effect_of_vehicle_dynamics_may_be_written_with_flat_names() -> None:
    """Its words go into `wording`; a grid is its own, which a rolling wheel's record has as well."""
    grid = ({"area_m2": 1.0},)
    words = {"name": "old", "sentence": "it pulls", "telling_drive": "coast"}
    old: type[DynamicsEffect] = type("Old", (DynamicsEffect,), {**words, "grid": grid})

    assert Wording(sentence="it pulls", distinguished_by="coast") == old.wording
    assert grid == old.grid
