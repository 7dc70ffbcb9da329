"""TOML that is made to cost: one clear line each, the right exit code, bounded time and memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tpmsd.foundation.toml_text import MAX_KEY_PARTS, parse_toml

COMMAND = """
import re, resource, sys
from pathlib import Path
from tpmsd.interfaces.cli.main import main
code = main(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_SELF)
# Of this process's own memory: what getrusage tells counts the tests' process before the exec, too.
peak = re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]
print(used.ru_utime + used.ru_stime, int(peak) / 1024)
sys.exit(code)
"""
MAX_S, MAX_MB = 10.0, 300.0
EFFECT = '[[effect]]\nname = "centrifugal_growth"\ncoefficient = {}\n'
DIGITS = "1" + 399 * "0"

CONFIGURATIONS = {
    "a key of 980 kB": (980_000 * "k" + " = 1\n", 20),
    "a dotted key of 980 kB": (".".join(490_000 * ["a"]) + " = 1\n", 1),
    "a table's name of 980 kB": ("[" + ".".join(490_000 * ["a"]) + "]\n", 1),
    "quoted keys of 980 kB": (".".join(245_000 * ['"a"']) + " = 1\n", 1),
    "90,000 unknown keys": ("".join(f"k{n} = 1\n" for n in range(90_000)), 21),
    "90,000 unknown tables": ("".join(f"[k{n}]\n" for n in range(90_000)), 21),
    "arrays in arrays": ("k = " + 100_000 * "[" + "\n", 1),
    "an integer of 5,000 digits": ("k = " + 5_000 * "1" + "\n", 1),
    "a radius of 400 digits": (f"[vehicle]\nwheel_radius_m = {DIGITS}\n", 20),
}
MODELS = {
    "a number of 400 digits": EFFECT.format(DIGITS),
    "a standard deviation of 400 digits": EFFECT.format(1e-6) + f"[effect.std]\ncoefficient = {DIGITS}\n",
    "a hexadecimal number of 1,000 digits": EFFECT.format("0x" + 1000 * "f"),
    "3,000 effects": 3000 * EFFECT.format(1e-6),
    "a name of 900 kB": f'[[effect]]\nname = "{900_000 * "x"}"\n',
    "a parameter of 900 kB": EFFECT.format(1e-6) + 900_000 * "x" + " = 1\n",
    "an unknown key of 900 kB": 900_000 * "x" + " = 1\n",
    "a dotted key of 980 kB": ".".join(490_000 * ["a"]) + " = 1\n",
}


def refused(words: list[str]) -> list[str]:
    """What a command says on standard error, having ended with 2 within its bounds."""
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *words], capture_output=True, text=True, check=False
    )
    assert 2 == done.returncode, done.stderr[-2000:]
    seconds, megabytes = map(float, done.stdout.split())
    assert seconds < MAX_S
    assert megabytes < MAX_MB
    lines = done.stderr.splitlines()
    assert max(map(len, lines)) < 500
    return lines


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_configurations(name: str, tmp_path: Path) -> None:
    """At most twenty problems are shown, then how many more and how many in all; lines stay short."""
    text, most = CONFIGURATIONS[name]
    (tmp_path / "vehicle.toml").write_text(text, "utf-8")
    lines = refused(["check", str(tmp_path / "vehicle.toml")])
    assert len(lines) <= most + 1
    assert f"{tmp_path / 'vehicle.toml'}: " in lines[-1] and lines[-1].endswith(("problem", "problems"))
    if name.startswith("90,000"):
        shown, more = lines[:20], lines[20]
        assert all(line.startswith(f"{tmp_path / 'vehicle.toml'}") for line in shown)
        count = int(lines[-1].rsplit(": ", 1)[1].split()[0])
        assert count >= 90_000
        assert f"and {count - 20} more problems" in more


@pytest.mark.parametrize("name", MODELS)
def test_models(name: str, tmp_path: Path) -> None:
    """One line that names the file."""
    path = tmp_path / "model.toml"
    path.write_text(MODELS[name], "utf-8")
    (line,) = refused(["simulate", str(tmp_path / "out"), "--model", str(path)])
    assert str(path) in line


@pytest.mark.parametrize("part", ["a", '"a b"', "'a.b'"])
def test_keys_up_to_the_bound_are_read(part: str) -> None:
    """A dotted key of as many parts as are allowed is read; one more is refused with its line."""
    data = parse_toml("x = 1\n" + ".".join(MAX_KEY_PARTS * [part]) + " = 1\n")
    assert {"x", part.strip("'\"")} == set(data)
    with pytest.raises(ValueError, match=r"^line 2: a key of more than 32 parts$"):
        parse_toml("x = 1\n" + " . ".join((MAX_KEY_PARTS + 1) * [part]) + " = 1\n")
