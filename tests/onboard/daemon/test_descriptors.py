"""Descriptors that the loop waits for follow links through their openings and closings."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from tpmsd.onboard.daemon.descriptors import Descriptors


class Line:
    """A link whose descriptor a test exchanges."""

    def __init__(self, descriptor: int | None) -> None:
        self.generation, self._descriptor = 0, descriptor

    def fileno(self) -> int | None:
        """Return the present descriptor."""
        return self._descriptor

    def exchange(self, descriptor: int | None) -> None:
        """Open another descriptor, or none."""
        self.generation, self._descriptor = self.generation + 1, descriptor


@pytest.fixture
def pipes() -> Iterator[list[tuple[int, int]]]:
    """Two pipes."""
    ends = [os.pipe(), os.pipe()]
    yield ends
    for end in (*ends[0], *ends[1]):
        os.close(end)


def test_a_link_is_waited_for_by_its_present_descriptor_alone(pipes: list[tuple[int, int]]) -> None:
    """What comes on the descriptor before is no sign of the link, nor is anything while it has none."""
    (first, into_first), (second, into_second) = pipes
    descriptors, line = Descriptors(), Line(first)
    descriptors.follow(line)
    os.write(into_first, b"x")
    assert [line] == descriptors.wait(0.0)
    line.exchange(second)
    descriptors.follow(line)
    assert [] == descriptors.wait(0.0)
    os.write(into_second, b"x")
    assert [line] == descriptors.wait(0.0)
    line.exchange(None)
    descriptors.follow(line)
    assert [] == descriptors.wait(0.0)
    line.exchange(first)
    descriptors.follow(line)
    assert [line] == descriptors.wait(0.0)
    descriptors.close()


def test_a_descriptor_that_was_closed_is_borne(pipes: list[tuple[int, int]]) -> None:
    """A link closes its own before the loop hears of it, and the number may be taken by the next."""
    (first, into_first), _ = pipes
    own = os.dup(first)
    descriptors, line = Descriptors(), Line(own)
    descriptors.follow(line)
    os.close(own)
    assert own == os.dup(first)
    line.exchange(own)
    descriptors.follow(line)
    os.write(into_first, b"x")
    assert [line] == descriptors.wait(0.0)
    descriptors.close()
    os.close(own)
