"""Any bytes from outside: no exception, no hang. The longer, coverage-guided run is `make fuzz`."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz.targets import IN_A_CHILD, SEEDS, TARGETS

FOUND = Path(__file__).parent / "found"
PATIENCE_S = 5.0
EXAMPLES = {"mf4": 8, "csv": 20, "map": 20, "store": 20, "dynamics": 30, "fmu": 30, "signals": 40}
"""Of slow readers fewer; `make fuzz` has the time."""
HERE = sorted({*TARGETS} - {*IN_A_CHILD})


@st.composite
def damaged(draw: st.DrawFn, seeds: list[bytes]) -> bytes:
    """A sound input with some places cut, doubled, overwritten or filled with others' pieces."""
    data = draw(st.sampled_from(seeds))
    for _ in range(draw(st.integers(0, 6))):
        at = draw(st.integers(0, max(len(data) - 1, 0)))
        to = min(at + draw(st.sampled_from([0, 1, 2, 5, 20, 200])), len(data))
        piece = draw(
            st.one_of(
                st.binary(max_size=6),
                st.sampled_from(
                    [b"", b"\n", b"$", b"-", b"1e999", b"nan", b"9" * 400, b"[" * 50, b'"', b",", b"\x00" * 9]
                ),
                st.just(data[at:to] * 2),
            )
        )
        data = data[:at] + piece + data[to:]
    return data


@pytest.mark.parametrize("name", HERE)
def test_damaged_input_is_borne(name: str) -> None:
    """Whatever is damaged in a sound input, the reader of it neither raises nor hangs."""

    @settings(derandomize=True, deadline=None, max_examples=EXAMPLES.get(name, 60), database=None)
    @given(damaged(SEEDS[name]()))
    def borne(data: bytes) -> None:
        began = time.monotonic()
        TARGETS[name](data)
        assert time.monotonic() - began < PATIENCE_S

    borne()


@pytest.mark.parametrize("name", HERE)
def test_any_bytes_are_borne(name: str) -> None:
    """Bytes without any sense, up to some thousand of them."""

    @settings(derandomize=True, deadline=None, max_examples=EXAMPLES.get(name, 40), database=None)
    @given(st.one_of(st.binary(max_size=300), st.binary(min_size=2000, max_size=6000)))
    def borne(data: bytes) -> None:
        TARGETS[name](data)

    borne()


def test_what_was_found_once_is_borne() -> None:
    """Inputs that a fuzzer found a fault with: the file's name begins with its target."""
    for path in sorted(FOUND.glob("*-*")):
        TARGETS[path.name.partition("-")[0]](path.read_bytes())
