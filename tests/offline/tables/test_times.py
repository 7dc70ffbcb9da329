"""Times of a user's table: what descends is refused with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from tpmsd.foundation.errors import InputError
from tpmsd.offline.tables.from_file import read_signals
from tpmsd.offline.tables.map_file import TableMap

HEAD = b"time_s,gnss_speed_mps,yaw_rate_radps\n"


@pytest.mark.parametrize(
    ("rows", "where"),
    [
        (b"1,5,\n2,5,\n\n1.5,5,\n", "log.csv:5: gnss_speed: time does not rise at 1.500000 s"),
        (b'1,5,\n"2",5,0\n3,,0\n1.5,,0\n', "log.csv:5: yaw_rate: time does not rise at 1.500000 s"),
    ],
)
def test_times_that_descend_are_refused_with_the_line(rows: bytes, where: str, tmp_path: Path) -> None:
    """The receiver's rows, too: they are not put in order silently."""
    (tmp_path / "log.csv").write_bytes(HEAD + rows)
    with pytest.raises(InputError) as refused:
        read_signals(tmp_path / "log.csv", TableMap())

    assert f"{tmp_path}/{where}" == str(refused.value)


def test_columns_may_stand_below_one_another(tmp_path: Path) -> None:
    """Each column has times of its own; a time may stand twice."""
    (tmp_path / "log.csv").write_bytes(HEAD + b"1,5,\n2,5,\n2,5,\n1,,0\n2,,0\n")
    series = read_signals(tmp_path / "log.csv", TableMap()).series

    assert [1.0, 2.0, 2.0] == series["gnss_speed"].finite().time_s.tolist()
    assert [1.0, 2.0] == series["yaw_rate"].finite().time_s.tolist()
