"""Which compiled kernels an installation has."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from tpmsd.foundation import kernels
from tpmsd.onboard.estimators.bank.kernel import compiled


def test_what_is_not_there_or_not_for_this_machine_is_not_found(tmp_path: Path) -> None:
    """A missing file, and one that no loader takes, count as absent; nothing is raised."""
    file = tmp_path / f"{kernels.FILES['bank']}{EXTENSION_SUFFIXES[-1]}"
    assert kernels.load_module(tmp_path, "bank") is None
    file.parent.mkdir(parents=True)
    file.write_bytes(b"\x7fELF of another processor")
    assert kernels.load_module(tmp_path, "bank") is None


def test_the_number_is_that_of_the_code_without_comments(tmp_path: Path) -> None:
    """Comments and line breaks leave it as it is, code changes it, and without sources there is none."""
    header, code = tmp_path / kernels.HEADERS[0], tmp_path / f"{kernels.FILES['gains']}.c"
    for file in (*(tmp_path / name for name in kernels.HEADERS), code):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("/* In: a.\n * Out: b. */\nint a;\n")
    number = kernels.sources_number(tmp_path, "gains")
    code.write_text("int a; /* other words */")
    same = kernels.sources_number(tmp_path, "gains")
    header.write_text("int a, b;")

    assert number is not None and same == number != kernels.sources_number(tmp_path, "gains")
    assert kernels.sources_number(tmp_path, "bank") is None


def test_kernels_of_other_sources_are_left_out_and_named(tmp_path: Path) -> None:
    """After a change of C that was not compiled: one line of warning, the kernel's twin in NumPy, and the
    version names the kernel; the same filter runs."""
    if not all(kernels.kernels().values()):
        pytest.skip("the compiled kernels are not built here (no compiler, or no headers of Python)")
    skipped = shutil.ignore_patterns("__pycache__", "static", "assets")
    shutil.copytree(Path(kernels.__file__).parents[1], tmp_path / "tpmsd", ignore=skipped)
    for name in ("bank", "evidence"):
        with (tmp_path / "tpmsd" / f"{kernels.FILES[name]}.c").open("a") as source:
            source.write("int one_more_argument;\n")
    program = (
        "from tpmsd.foundation.kernels import kernel\n"
        "from tpmsd.offline.inference import gains\n"
        "from tpmsd.onboard.estimators.bank.kernel import HALF_KERNEL, KERNEL\n"
        "from tpmsd.onboard.monitor.evidence.kernel import compiled\n"
        "print(type(KERNEL).__name__, type(HALF_KERNEL).__name__, compiled, gains.compiled is None)\n"
        "print(kernel())\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", program]
    said = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)

    assert [
        "ArrayKernel ArrayKernel None False",
        "compiled: gains, candump, nmea (outdated: bank, evidence)",
    ] == said.stdout.splitlines()
    (line,) = said.stderr.splitlines()
    assert "(bank, evidence)" in line and "build_ext --inplace" in line


@pytest.mark.parametrize(
    ("there", "word"),
    [
        ((True, True, True, True, True), "compiled"),
        ((False, False, False, False, False), "numpy"),
        ((True, False, True, False, False), "compiled: bank, candump"),
    ],
)
def test_one_word_for_all_kernels(
    there: tuple[bool, ...], word: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All, none, or the names of those that can be loaded."""
    monkeypatch.setattr(kernels, "kernels", lambda: dict(zip(kernels.FILES, there, strict=True)))
    assert word == kernels.kernel()


def test_the_word_agrees_with_what_is_imported() -> None:
    """The bank is said to be compiled exactly where its module was imported."""
    assert kernels.kernels()["bank"] == (compiled is not None)
