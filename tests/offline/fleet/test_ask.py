"""Questions in SQL are bounded, and their answers obey no terminal."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.fleet.sql_query import as_text, ask
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import write_tables


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store.create(tmp_path / "store")
    write_tables(made)
    return made


@pytest.mark.parametrize(
    "query",
    [
        "",
        ";",
        "select 1; select 2",
        "call enable_logging(storage = 'file', storage_config = {'path': 'FILE'})",
        "copy drives to 'FILE'",
        "set memory_limit = '100GB'",
        "attach 'FILE'",
        "create table x as select 1",
    ],
)
def test_only_a_question_is_answered(query: str, store: Store, tmp_path: Path) -> None:
    """What is no single question ends with one line, and writes nothing."""
    with pytest.raises(ConfigError, match="query: ") as reported:
        ask(store, query.replace("FILE", str(tmp_path / "made")))

    assert "\n" not in str(reported.value)
    assert ["store"] == [path.name for path in tmp_path.iterdir()]


def test_a_question_has_a_time_limit(store: Store) -> None:
    """A question without end is stopped."""
    begun_s = time.monotonic()
    with pytest.raises(ConfigError, match="takes more than 1 s"):
        ask(
            store,
            "select sum(sin(range)) from range(1000000000000)",
            max_s=1.0,
        )

    assert time.monotonic() - begun_s < 30.0


def test_a_question_has_a_memory_limit(store: Store) -> None:
    """A question that gathers more than 512 MB is refused."""
    with pytest.raises(ConfigError, match=r"(?i)memory"):
        ask(store, "select list(range) from range(200000000)")


def test_a_question_has_a_limit_of_rows(store: Store) -> None:
    """An answer of more than 100 000 rows is refused."""
    with pytest.raises(ConfigError, match="more than 100000 rows"):
        ask(store, "select * from range(1000000)")


def test_columns_of_one_name_are_kept_apart(store: Store) -> None:
    """Each column of an answer has a name of its own."""
    assert (["a", "a_2", "a_3"], [(1, 2, 3)]) == ask(store, "select 1 as a, 2 as a, 3 as a")


def test_escape_sequences_do_not_reach_the_terminal(store: Store) -> None:
    """Names and cells are shown without control characters, those of C1 and of direction among them."""
    text = as_text(*ask(store, "select chr(27) || '[2J' || chr(155) || chr(8238) as \"x\x1b[1m\""))

    assert all(line.isprintable() for line in text.splitlines())
    assert 2 == len(text.splitlines())
