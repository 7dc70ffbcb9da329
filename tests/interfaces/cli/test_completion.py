"""Completions and manual pages say what the parser takes."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tpmsd.interfaces.cli.completion import commands_of, fish, zsh
from tpmsd.interfaces.cli.main import COMMANDS, full_parser, main

REPO = Path(__file__).resolve().parents[3]
ASK = 'COMP_WORDS=({words}); COMP_CWORD={last}; _tpmsd; echo "${{COMPREPLY[@]}}"'


def completed(script: str, *words: str) -> list[str]:
    """What bash offers for the last of the words."""
    asked = ASK.format(words=" ".join(f"'{word}'" for word in words), last=len(words) - 1)
    done = subprocess.run(["bash", "-c", f"{script}\n{asked}"], capture_output=True, text=True, check=True)
    assert "" == done.stderr
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_options_and_choices(capsys: pytest.CaptureFixture[str]) -> None:
    """A beginning of a command, of an option, and the values of an option with choices."""
    assert 0 == main(["completion", "bash"])
    script = capsys.readouterr().out

    assert ["replay"] == completed(script, "tpmsd", "repl")
    assert ["--parquet", "--plot"] == sorted(completed(script, "tpmsd", "replay", "--p"))
    assert ["mixed", "motorway"] == sorted(completed(script, "tpmsd", "simulate", "--route", "m"))
    assert ["sun_side"] == completed(script, "tpmsd", "effects", "sun")
    assert ["sun_side"] == completed(script, "tpmsd", "simulate", "--effect", "sun")
    assert ["report", "run"] == sorted(completed(script, "tpmsd", "fleet", "r"))


def test_every_command_and_option_is_in_all_scripts() -> None:
    """Nothing that the parser takes is missing, and no quote of a help text ends a string of the script."""
    commands = commands_of(full_parser())

    assert [name for name, _, _ in COMMANDS] == [each.name for each in commands]
    for script in (zsh(commands), fish(commands)):
        assert [] == [line for line in script.splitlines() if line.count("'") % 2]
        for each in commands:
            missing = [option for option, _, _ in each.options if option.lstrip("-") not in script]
            assert ([], True) == (missing, each.name in script)


def test_every_command_has_a_manual_page(tmp_path: Path) -> None:
    """A page each, which troff formats without a warning, with all options."""
    made = [sys.executable, str(REPO / "tools" / "make_man.py"), str(tmp_path)]
    subprocess.run(made, check=True, cwd=REPO)
    pages = {path.stem for path in tmp_path.glob("*.1")}

    assert {"tpmsd", *(f"tpmsd-{name}" for name, _, _ in COMMANDS)} == pages
    for each in commands_of(full_parser()):
        text = (tmp_path / f"tpmsd-{each.name}.1").read_text().replace("\\-", "-")
        assert [] == [option for option, _, _ in each.options if option not in text]
    if shutil.which("groff") is None:
        pytest.skip("no groff to format them with")
    files = sorted(map(str, tmp_path.glob("*.1")))
    done = subprocess.run(["groff", "-ww", "-man", "-Tascii", "-z", *files], capture_output=True, text=True)
    assert (0, "") == (done.returncode, done.stderr)
