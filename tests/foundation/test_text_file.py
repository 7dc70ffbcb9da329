"""Small text files, bounded."""

from __future__ import annotations

from pathlib import Path

import pytest

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.text_file import read_text


def test_a_text_is_read_up_to_its_bound(tmp_path: Path) -> None:
    """As many bytes as are allowed, signs of several bytes counted so."""
    (tmp_path / "f").write_text("äb\n", "utf-8")

    assert "äb\n" == read_text(tmp_path / "f", 4, "a text")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"12345", "longer than 4 bytes: this is not a text"),
        (b"\xff", "is not UTF-8 text"),
        (None, "cannot be read: No such file or directory"),
    ],
)
def test_what_is_no_such_text_is_refused(tmp_path: Path, content: bytes | None, reason: str) -> None:
    """One line that names the file and the reason."""
    if content is not None:
        (tmp_path / "f").write_bytes(content)
    with pytest.raises(ConfigError) as refused:
        read_text(tmp_path / "f", 4, "a text")

    assert f"{tmp_path / 'f'}: {reason}" == str(refused.value)


def test_a_path_that_cannot_be_is_refused() -> None:
    """A NUL byte and a folder are one line, too."""
    for path in (Path("a\0b"), Path("/")):
        with pytest.raises(ConfigError, match="cannot be read: "):
            read_text(path, 4, "a text")
