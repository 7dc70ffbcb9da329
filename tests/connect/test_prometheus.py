"""Debian's prometheus and promtool against the bridge, run as a process of its own."""

from __future__ import annotations

import contextlib
import json
import re
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from tests.conftest import REPO
from tests.connect.servers import Server, free_port, program, wait_for
from tests.interfaces.bridges.documents import alarm, document, served
from tpmsd.interfaces.bridges.metrics import families

CONTRIB = REPO / "contrib"
RULES = CONTRIB / "prometheus" / "tpmsd-rules.yml"
DASHBOARD = json.loads((CONTRIB / "grafana" / "tpmsd.json").read_text("utf-8"))


def bridge(folder: Path, port: int) -> Server:
    options = ["--socket", str(folder / "s"), "--port", str(port)]
    command = [sys.executable, "-m", "tpmsd", "bridge", "prometheus", *options]
    return Server(command, folder / "bridge.log", port)


def get(url: str) -> Any:
    with urllib.request.urlopen(url, timeout=5.0) as answer:
        return json.loads(answer.read())


def is_ready(port: int) -> bool:
    """Prometheus answers 503 for a while after it has begun to listen."""
    with (
        contextlib.suppress(OSError),
        urllib.request.urlopen(f"http://127.0.0.1:{port}/-/ready", timeout=5.0),
    ):
        return True
    return False


def test_prometheus_scrapes_and_the_alert_fires(tmp_path: Path) -> None:
    """An alarm of the daemon becomes a firing alert and goes again; a dead daemon shows as tpmsd_up 0."""
    port, own = free_port(), free_port()
    configuration = (CONTRIB / "prometheus" / "prometheus.yml").read_text("utf-8")
    configuration = configuration.replace("127.0.0.1:9838", f"127.0.0.1:{port}").replace(": 5s", ": 1s")
    configuration = configuration.replace("tpmsd-rules.yml", str(RULES))
    (tmp_path / "prometheus.yml").write_text(configuration, "utf-8")
    server = Server(
        [
            program("prometheus"),
            f"--config.file={tmp_path}/prometheus.yml",
            f"--storage.tsdb.path={tmp_path}/data",
            f"--web.listen-address=127.0.0.1:{own}",
        ],
        tmp_path / "prometheus.log",
        own,
    )

    def firing() -> list[str]:
        alerts = get(f"http://127.0.0.1:{own}/api/v1/alerts")["data"]["alerts"]
        return [
            f"{one['labels']['alertname']} {one['labels'].get('wheel')}"
            for one in alerts
            if one["state"] == "firing"
        ]

    def up() -> list[str]:
        found = get(f"http://127.0.0.1:{own}/api/v1/query?query=tpmsd_up")["data"]["result"]
        return [one["value"][1] for one in found]

    with bridge(tmp_path, port), server:
        wait_for("prometheus", lambda: is_ready(own), 30.0)
        with served(tmp_path / "s") as daemon:
            wait_for("a scrape", lambda: up() == ["1"])
            assert [] == firing()
            daemon.document = document(alarm())
            assert ["TyreSoft rl"] == wait_for("the alert", firing)
            daemon.document = document()
            wait_for("the end of the alert", lambda: firing() == [])
        wait_for("the end of the daemon", lambda: up() == ["0"])


def test_promtool_finds_nothing_wrong(tmp_path: Path) -> None:
    """Rules and example are valid, the rules fire when they should, and the metrics are named as usual."""
    promtool = program("promtool")
    port = free_port()
    for arguments in (
        ["check", "rules", "tpmsd-rules.yml"],
        ["check", "config", "prometheus.yml"],
        ["test", "rules", "tpmsd-rules-test.yml"],
    ):
        done = subprocess.run([promtool, *arguments], cwd=RULES.parent, capture_output=True, text=True)
        assert 0 == done.returncode, done.stdout + done.stderr
    with served(tmp_path / "s"), bridge(tmp_path, port):
        text = urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5.0).read()
    linted = subprocess.run([promtool, "check", "metrics"], input=text, capture_output=True)

    assert (0, b"") == (linted.returncode, linted.stdout + linted.stderr)


EXPRESSIONS = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]


def test_the_dashboard_asks_for_what_there_is(tmp_path: Path) -> None:
    """Every expression of dashboard and rules is valid, and names metrics that the bridge serves."""
    (tmp_path / "r.yml").write_text(
        json.dumps(
            {
                "groups": [
                    {
                        "name": "g",
                        "rules": [{"record": f"r{k}", "expr": expr} for k, expr in enumerate(EXPRESSIONS)],
                    }
                ]
            }
        ),
        "utf-8",
    )
    done = subprocess.run([program("promtool"), "check", "rules", "r.yml"], cwd=tmp_path, capture_output=True)
    served_names = {
        family.name + ("_total" if family.kind == "counter" else "") for family in families(document())
    }

    named = set(re.findall(r"tpmsd_\w+", " ".join(EXPRESSIONS) + RULES.read_text("utf-8")))

    assert 0 == done.returncode, done.stderr
    assert named and named <= served_names


PANEL = {
    "type": "object",
    "required": ["id", "type", "title", "datasource", "gridPos", "targets", "fieldConfig", "options"],
    "properties": {
        "id": {"type": "integer", "minimum": 1},
        "type": {"enum": ["stat", "timeseries"]},
        "gridPos": {
            "type": "object",
            "required": ["x", "y", "w", "h"],
            "properties": {
                "x": {"type": "integer", "minimum": 0, "maximum": 23},
                "w": {"type": "integer", "minimum": 1, "maximum": 24},
                "h": {"type": "integer", "minimum": 1},
            },
        },
        "targets": {
            "type": "array",
            "minItems": 1,
            "items": {"type": "object", "required": ["refId", "expr", "datasource"]},
        },
        "fieldConfig": {"type": "object", "required": ["defaults", "overrides"]},
    },
}
SCHEMA = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "type": "object",
    "required": ["uid", "title", "schemaVersion", "panels", "time", "templating"],
    "properties": {
        "uid": {"type": "string", "maxLength": 40},
        "title": {"type": "string", "minLength": 1},
        "schemaVersion": {"type": "integer", "minimum": 36},
        "panels": {"type": "array", "minItems": 1, "items": PANEL},
        "templating": {"type": "object", "required": ["list"]},
    },
}
"""After Grafana's documentation, "Dashboard JSON model"."""


def test_the_dashboard_has_grafanas_form() -> None:
    """Panels have what Grafana needs of them, do not overlap, and have numbers of their own."""
    jsonschema.validate(DASHBOARD, SCHEMA)
    cells = [
        (x, y)
        for panel in DASHBOARD["panels"]
        for x in range(panel["gridPos"]["x"], panel["gridPos"]["x"] + panel["gridPos"]["w"])
        for y in range(panel["gridPos"]["y"], panel["gridPos"]["y"] + panel["gridPos"]["h"])
    ]

    assert len(cells) == len(set(cells))
    assert len(DASHBOARD["panels"]) == len({panel["id"] for panel in DASHBOARD["panels"]})
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(DASHBOARD | {"panels": []}, SCHEMA)
