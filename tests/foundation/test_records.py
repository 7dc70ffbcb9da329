"""Records that are made quickly are frozen dataclasses in all else."""

from __future__ import annotations

import copy
import pickle
import timeit
from dataclasses import FrozenInstanceError, asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np
import pytest

from tpmsd.foundation.records import quickly_made
from tpmsd.onboard.timeline.tick import Fix, Tick


@dataclass(frozen=True, slots=True)
class Plain:
    first: int
    second: str
    third: float = 3.0
    fourth: tuple[int, ...] = field(default=())


@quickly_made
@dataclass(frozen=True, slots=True)
class Quick:
    first: int
    second: str
    third: float = 3.0
    fourth: tuple[int, ...] = field(default=())


def test_a_record_is_the_one_that_a_dataclass_makes() -> None:
    """Defaults, names, equality, text, hash and copies."""
    plain, quick = Plain(1, "b", fourth=(4,)), Quick(1, "b", fourth=(4,))
    assert type(quick) is Quick
    assert asdict(quick) == asdict(plain)
    assert repr(quick) == repr(plain).replace("Plain", "Quick")
    assert quick == Quick(first=1, second="b", fourth=(4,))
    assert quick != replace(quick, first=2)
    assert hash(quick) == hash(plain)
    assert replace(quick, third=5.0) == Quick(1, "b", 5.0, (4,))
    assert copy.deepcopy(quick) == pickle.loads(pickle.dumps(quick)) == copy.copy(quick) == quick


def test_a_record_is_frozen() -> None:
    """Once it is made, no field can be set, deleted or added."""
    quick = Quick(1, "b")
    with pytest.raises(FrozenInstanceError):
        quick.first = 2  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError):
        del quick.second
    with pytest.raises((FrozenInstanceError, TypeError)):
        quick.other = 1  # type: ignore[attr-defined]


def test_a_record_wants_all_of_its_values_and_no_other() -> None:
    """As any function does."""
    with pytest.raises(TypeError, match="second"):
        Quick(1)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="other"):
        Quick(1, "b", other=1)  # type: ignore[call-arg]


def test_a_field_that_needs_more_than_its_value_is_declined() -> None:
    """What makes a default, or comes after the values, would be left out."""

    @dataclass(frozen=True, slots=True)
    class Made:
        values: list[int] = field(default_factory=list)

    @dataclass(frozen=True, slots=True)
    class Checked:
        value: int

        def __post_init__(self) -> None:
            assert self.value

    for record in (Made, Checked):
        with pytest.raises(TypeError, match="more than its values"):
            quickly_made(record)


def test_ticks_are_made_in_half_the_time() -> None:
    """Of a dataclass with the same fields; a quarter as a rule."""
    slow: Any = dataclass(frozen=True, slots=True)(
        type("Slow", (), {"__annotations__": {part.name: part.type for part in fields(Tick)}})
    )
    values = [np.zeros(4)] * len(fields(Tick))
    quick_s, slow_s = (
        min(timeit.repeat(lambda made=made: made(*values), number=500, repeat=20))  # type: ignore[misc]
        for made in (Tick, slow)
    )
    assert quick_s < 0.5 * slow_s
    assert type(Fix(1.0, 0.5, 0.0, 0.0, 1.0)) is Fix
