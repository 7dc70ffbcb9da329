"""Work that is resumed, and the intervals of what it found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, poisson

from bench import statistics
from bench.runner import code_state, each, key_of, last_state, read, resume


def squares(
    file: Path, units: list[tuple[int]], state: str = "a", **more: int
) -> list[tuple[tuple[int], int]]:
    return resume(file, state, units, square, lambda unit, result: f"{unit}", **more)  # type: ignore[arg-type]


def square(unit: tuple[int]) -> int:
    return unit[0] ** 2


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_units(jobs: int, tmp_path: Path) -> None:
    """Whatever the number of processes."""
    units = [(3,), (1,), (2,)]

    assert [((3,), 9), ((1,), 1), ((2,), 4)] == squares(tmp_path / "x.jsonl", units, jobs=jobs)


def test_what_stands_there_is_not_done_again(tmp_path: Path) -> None:
    """Of the same state; a line that was cut off, and one of another state, do not count."""
    file = tmp_path / "x.jsonl"
    there = [{"unit": [2], "state": "a", "result": 77}, {"unit": [3], "state": "old", "result": 88}]
    file.write_text("\n".join(map(json.dumps, there)) + '\n{"unit": [4], "sta')

    assert [((2,), 77), ((3,), 9)] == squares(file, [(2,), (3,)])
    assert [((2,), 77), ((3,), 9)] == squares(file, [(2,), (3,)])
    assert ["[2]", "[3]", "[3]"] == [entry.unit for entry in read(file)]
    assert [77, 9] == last_state(file)


def test_no_unit_is_begun_when_the_time_is_up(tmp_path: Path) -> None:
    """Nothing is done, and nothing is lost."""
    assert [] == squares(tmp_path / "x.jsonl", [(2,)], minutes=-1)
    assert [] == list(each([(2,)], square, 2, minutes=-1.0))
    assert [((2,), 4)] == squares(tmp_path / "x.jsonl", [(2,)])


def test_another_state_of_the_code_is_another_checksum(tmp_path: Path) -> None:
    """A changed byte or a new module; not another folder with the same content."""
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        folder.mkdir()
        (folder / "x.py").write_text("a = 1\n")
    before = code_state(one)

    assert before == code_state(other)
    (one / "x.py").write_text("a = 2\n")
    assert before != code_state(one)


def test_keys_of_units_are_what_is_read_back(tmp_path: Path) -> None:
    """Tuples become lists and come back as the same key."""
    squares(tmp_path / "x.jsonl", [(5,)])

    assert [key_of((5,))] == [entry.unit for entry in read(tmp_path / "x.jsonl")]


@pytest.mark.parametrize(("hits", "total"), [(0, 20), (3, 20), (20, 20)])
def test_shares_bear_the_exact_interval(hits: int, total: int) -> None:
    """At its ends the observed number, or a rarer one, has a probability of 2.5 %."""
    found = statistics.share(hits, total)

    if hits > 0:
        assert binom.sf(hits - 1, total, found["low"]) == pytest.approx(0.025)
    if hits < total:
        assert binom.cdf(hits, total, found["high"]) == pytest.approx(0.025)
    assert found["low"] <= hits / total <= found["high"]


def test_rates_bear_the_exact_interval() -> None:
    """At its ends four events, or a rarer number, have a probability of 2.5 %; none gives no lower end."""
    found = statistics.rate(4, 500.0, 100.0)

    assert (4, 0.8) == (found["events"], pytest.approx(found["rate"]))
    assert poisson.cdf(4, found["high"] * 5.0) == pytest.approx(0.025)
    assert poisson.sf(3, found["low"] * 5.0) == pytest.approx(0.025)
    assert 0.0 == statistics.rate(0, 500.0, 100.0)["low"]


def test_uniform_p_values_pass_and_small_ones_do_not() -> None:
    """The test of Kolmogorov and Smirnov; of a few values it says nothing."""
    rng = np.random.default_rng(1)

    uniform = statistics.uniform(rng.uniform(size=60).tolist())
    small = statistics.uniform((0.3 * rng.uniform(size=60)).tolist())
    assert uniform is not None
    assert small is not None
    assert uniform > 0.05 > 1e-6 > small
    assert statistics.uniform([0.1, 0.2]) is None


def test_groups_that_differ_beyond_chance_are_distinguished() -> None:
    """None of forty against ten of forty; two of forty against one of forty is chance."""
    share = statistics.share

    assert statistics.apart(share(0, 40), share(10, 40)) < 0.01 < statistics.apart(share(2, 40), share(1, 40))
