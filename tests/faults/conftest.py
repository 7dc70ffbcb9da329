"""Both filters of the product go through the same faults and attacks."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.faults import drives


@pytest.fixture(scope="module", params=drives.METHODS)
def method(request: pytest.FixtureRequest) -> Iterator[str]:
    """The filter with which drives are played meanwhile."""
    drives.PLAYED_WITH.append(request.param)
    yield request.param
    drives.PLAYED_WITH.pop()
