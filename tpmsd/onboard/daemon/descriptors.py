"""Descriptors that the loop waits for: permanent ones, and those of links that open and close.

In: descriptors. Out: who of them has something to say.
"""

from __future__ import annotations

import contextlib
import selectors
from typing import Any, Protocol


class ChangingDescriptor(Protocol):
    """Something whose descriptor changes, as `Link`."""

    generation: int
    """Rises whenever the descriptor is another one."""

    def fileno(self) -> int | None:
        """Return the descriptor; None if there is none."""


class Descriptors:
    """A selector that follows links through their openings and closings."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._followed: dict[int, tuple[int, int | None]] = {}

    def add(self, descriptor: int, owner: Any) -> None:
        """Watch a descriptor that stays."""
        self._selector.register(descriptor, selectors.EVENT_READ, owner)

    def follow(self, link: ChangingDescriptor) -> None:
        """Watch a link's present descriptor, and no more the one before; call before every wait."""
        generation, watched = self._followed.get(id(link), (None, None))
        if generation == link.generation:
            return
        if watched is not None:
            # It is closed by now, and its number may be another file's; the selector bears that.
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(watched)
        descriptor = link.fileno()
        if descriptor is not None:
            self._selector.register(descriptor, selectors.EVENT_READ, link)
        self._followed[id(link)] = (link.generation, descriptor)

    def wait(self, seconds: float) -> list[Any]:
        """Return the owners of what is readable, at the latest after so many real seconds."""
        return [key.data for key, _ in self._selector.select(seconds)]

    def close(self) -> None:
        """Watch nothing any more."""
        self._selector.close()
