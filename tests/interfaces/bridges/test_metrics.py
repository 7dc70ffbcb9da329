"""The metrics, as Prometheus's own parser reads them."""

from __future__ import annotations

import logging
import socket
import threading
import time
import urllib.request
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from prometheus_client.parser import text_string_to_metric_families

from tests.interfaces.bridges.documents import alarm, document, served
from tests.interfaces.bridges.test_summary import junk
from tpmsd.foundation.errors import TpmsdError
from tpmsd.interfaces.bridges import prometheus
from tpmsd.interfaces.bridges.metrics import families
from tpmsd.interfaces.bridges.prometheus import serve

LOG = logging.getLogger("tests.interfaces.bridges")


def scrape(port: int) -> dict[tuple[str, ...], float]:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5.0) as answer:
        text = answer.read().decode()
    return {
        (sample.name, *(value for _, value in sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_a_scrape_gives_base_units(tmp_path: Path) -> None:
    """Metres, ratios and seconds, with the labels that rules go by; without a daemon, tpmsd_up alone."""
    port, end = serve(tmp_path / "s", "127.0.0.1", 0, LOG)
    try:
        with served(tmp_path / "s") as daemon:
            daemon.document = document(alarm(), alarm("malfunction", None))
            got = scrape(port)
        gone = scrape(port)
    finally:
        end()

    expected = {
        ("tpmsd_up",): 1.0,
        ("tpmsd_build_info", "9.9"): 1.0,
        ("tpmsd_wheel_radius_deviation_meters", "rl"): -0.0005,
        ("tpmsd_wheel_pressure_loss_ratio", "rl"): 0.04,
        ("tpmsd_wheel_state", "monitoring", "fl"): 1.0,
        ("tpmsd_wheel_state", "alarm", "fl"): 0.0,
        ("tpmsd_alarm_active", "deflation", "rl"): 1.0,
        ("tpmsd_alarm_active", "deflation", "rr"): 0.0,
        ("tpmsd_alarm_active", "slow_leak", "rl"): 0.0,
        ("tpmsd_alarm_active", "malfunction", "all"): 1.0,
        ("tpmsd_source_up", "gnss"): 1.0,
        ("tpmsd_source_received_total", "can"): 1234.0,
        ("tpmsd_source_faults_total", "lost", "can"): 3.0,
        ("tpmsd_ticks_total",): 600.0,
        ("tpmsd_missed_deadlines_total",): 2.0,
        ("tpmsd_uptime_seconds",): 60.0,
        ("tpmsd_vehicle_speed_meters_per_second",): 20.0,
    }
    assert expected == {key: got.get(key) for key in expected}
    assert {("tpmsd_up",): 0.0} == gone


def test_nothing_listens_beyond_the_loopback_unless_configured(tmp_path: Path) -> None:
    """The server is bound to the address that it was given; a taken port is one clear line."""
    port, end = serve(tmp_path / "s", "127.0.0.1", 0, LOG)
    try:
        with pytest.raises(TpmsdError, match=f"127.0.0.1:{port}: cannot listen: Address already in use"):
            serve(tmp_path / "s", "127.0.0.1", port, LOG)
        with pytest.raises(OSError):
            urllib.request.urlopen(f"http://127.0.0.2:{port}/metrics", timeout=1.0)
    finally:
        end()


def test_half_sent_requests_neither_pile_up_nor_stay(tmp_path: Path) -> None:
    """Sixty connections that ask for nothing are taken at once, hold a bounded number of threads,
    and are closed in time."""
    before = threading.active_count()
    with pytest.MonkeyPatch.context() as patched, ExitStack() as stack:
        patched.setattr(prometheus, "REQUEST_S", 1.0, raising=False)
        port, end = serve(tmp_path / "s", "127.0.0.1", 0, LOG)
        stack.callback(end)
        begun_s = time.monotonic()
        for _ in range(60):
            client = stack.enter_context(socket.create_connection(("127.0.0.1", port), 5.0))
            client.sendall(b"GET /metrics HTTP/1.1\r\nX-Half: ")
        connected_s = time.monotonic() - begun_s
        time.sleep(0.3)
        most = threading.active_count() - before
        time.sleep(1.7)
        got = scrape(port)

    assert connected_s < 5.0  # none waits for a place in the queue, a second each
    assert most <= 2 * 16 + 1  # one each, one that ends it, one that listens
    assert {("tpmsd_up",): 0.0} == got


@settings(derandomize=True, deadline=None, max_examples=150)
@given(junk, junk, junk)
def test_strange_documents_make_no_strange_series(wheels: Any, can: Any, alarms: Any) -> None:
    """Whatever a document holds, the number of series is bounded and every value is a finite number."""
    made = list(families(document(wheels=wheels, can=can, alarms=alarms)))

    assert sum(len(family.samples) for family in made) < 600
    assert all(abs(value) < float("inf") for family in made for _, value in family.samples)
