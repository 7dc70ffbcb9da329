"""Which compiled kernels an installation has."""

from __future__ import annotations

from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from tpmsd.foundation import kernels
from tpmsd.onboard.estimators.bank.kernel import compiled, usable


def test_what_is_not_there_or_not_for_this_machine_is_not_loadable(tmp_path: Path) -> None:
    """A missing file, and one that no loader takes, count as absent; nothing is raised."""
    assert not kernels.loadable(tmp_path / "_bank")
    (tmp_path / f"_bank{EXTENSION_SUFFIXES[-1]}").write_bytes(b"\x7fELF of another processor")
    assert not kernels.loadable(tmp_path / "_bank")


@pytest.mark.parametrize(
    ("there", "word"),
    [
        ((True, True, True, True), "compiled"),
        ((False, False, False, False), "numpy"),
        ((True, False, True, False), "compiled: bank, candump"),
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
    assert kernels.kernels()["bank"] == (compiled is not None) == usable(compiled)
