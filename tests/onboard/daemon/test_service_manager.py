"""Messages to the service manager, by a notifier that keeps them."""

from __future__ import annotations

from tpmsd.onboard.daemon.service_manager import STATUS_S, ServiceManager


class Kept:
    """A notifier whose watchdog wants to be fed every ten seconds."""

    watchdog_period_s = 10.0

    def __init__(self) -> None:
        self.said: list[str] = []

    def ready(self, line: str) -> None:
        self.said.append(f"ready {line}")

    def status(self, line: str) -> None:
        self.said.append(f"status {line}")

    def watchdog(self) -> None:
        self.said.append("fed")


def test_the_first_tick_makes_it_ready_and_feeds_the_watchdog() -> None:
    """Without a tick it is neither; one tick more and a period later the watchdog is fed again."""
    kept = Kept()
    manager = ServiceManager(kept)  # type: ignore[arg-type]
    for ticks, now_s in ((0, 0.0), (1, 1.0), (1, 12.0), (2, 12.5)):
        manager.note_ticks(ticks, lambda: "well", now_s)

    assert ["ready well", "fed", "status well", "fed"] == kept.said
    assert STATUS_S < 11.0
