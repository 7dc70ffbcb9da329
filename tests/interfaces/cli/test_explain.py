"""`tpmsd explain`: what stands behind an alarm, and behind there being none."""

from __future__ import annotations

import json
import math
from datetime import timedelta, timezone
from pathlib import Path
from typing import Any

import pytest

from tests.onboard.monitor.drives import ALL, RADIUS_M, VEHICLE, Player, one
from tpmsd.car.config.model import MonitorConfig
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.report.explanation_text import explanation_text
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.gates.agreement import AGREED, Agreement
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.records import MonitorReport
from tpmsd.onboard.resonance.evidence import ResonanceEvidence
from tpmsd.onboard.sinks.explanation import EXPLANATION, Explanation
from tpmsd.onboard.sinks.status_server import StatusServer
from tpmsd.onboard.timeline.tick import Tick


class Explained(Monitor):
    """A monitor whose ticks go to an explanation as well, as the pipeline does it."""

    def __init__(self) -> None:
        config = MonitorConfig()
        super().__init__(VEHICLE, config, ALL)
        self.explanation = Explanation(ALL, config)

    def update(
        self,
        tick: Tick,
        estimate: RadiusEstimate,
        resonance: ResonanceEvidence | None = None,
        agreement: Agreement = AGREED,
    ) -> MonitorReport:
        """The report, explained."""
        report = super().update(tick, estimate, resonance, agreement)
        self.explanation.update(tick, estimate, agreement, resonance, self.judgement, report)
        return report

    def explain(self) -> dict[str, Any]:
        """The document, which is JSON."""
        document = self.explanation.document(self)
        json.dumps(document, allow_nan=False)
        return document


class Explainer(Player):
    """Plays driving into a monitor that explains."""

    def __init__(self, dt_s: float = 0.1) -> None:
        super().__init__(Explained(), dt_s)

    def explain(self) -> dict[str, Any]:
        """The document now."""
        assert isinstance(self.monitor, Explained)
        return self.monitor.explain()


def test_an_alarm_states_what_was_believed_and_by_whom_it_was_seen() -> None:
    """A loss of 1 % of fr: the radius before is the learned one; front against rear and fl against fr moved,
    the rear pair did not, and the alternatives lost for reasons that are said."""
    player = Explainer()
    player.play(200.0)
    player.play(60.0, one(1, -0.01))
    document = player.explain()
    alarm = next(a for a in document["alarms"] if a["kind"] == "deflation")
    assert ("fr", "raised") == (alarm["wheel"], alarm["state"])
    assert -0.5 == pytest.approx(alarm["before_mm"], abs=0.15)
    last = alarm["evidence"][-1]["evidence_by_source"]
    assert 1e3 * 0.01 * RADIUS_M == pytest.approx(last["fl_minus_fr"]["change_mm"], abs=0.3)
    assert -1e3 * 0.01 * RADIUS_M / 4.0 == pytest.approx(last["front_minus_rear"]["change_mm"] / 1.0, abs=1.0)
    assert 0.0 == pytest.approx(last["rl_minus_rr"]["change_mm"], abs=0.2)
    assert last["resonance_log_ratio"] is None
    best, *others = alarm["alternatives"]
    assert ("fr lost radius", "the most probable") == (best["what"], best["why"])
    assert all(entry["why"].startswith("fits") for entry in others)
    none = [entry for entry in others if entry["what"] == "no tyre has changed"]
    assert [] == none or none[0]["why"].startswith("fits worse")
    assert [0.0] == [entry["nats_to_lead"] for entry in alarm["alternatives"] if entry is best]
    assert all(
        math.log(best["probability"] / entry["probability"]) == pytest.approx(entry["nats_to_lead"], abs=0.02)
        for entry in others
        if entry["probability"] > 1e-4
    )
    assert sum(entry["probability"] for entry in alarm["alternatives"]) == pytest.approx(1.0, abs=0.05)
    assert document["would_change"][0].startswith(f"{document['alternatives'][1]['what']}: evidence of ")
    assert "at most 0.2 for 60 s" in alarm["clears_when"]
    text = explanation_text(document)
    assert "fr lost radius: the most probable" in text
    assert "The radius before: -0." in text


def test_without_an_alarm_it_states_what_is_missing() -> None:
    """Learning, motion, sky and a small change have a sentence each; the smallest loss seen is a number."""
    player = Explainer()
    assert "nothing was judged yet" == player.explain()["wheels"]["fl"]["why_no_alarm"]
    player.play(20.0)
    assert any(line.startswith("learning: ") for line in player.explain()["why_no_alarm"])
    player.play(200.0)
    settled = player.explain()
    assert [] == settled["why_no_alarm"]
    assert 0.25 / 100 * RADIUS_M * 1e3 < settled["wheels"]["rl"]["smallest_loss_seen_mm"] < 2.5
    assert "no tyre has changed" == settled["alternatives"][0]["what"]
    player.play(120.0, informative=False, speed_mps=10.0, gnss_age_s=60.0)
    lines = player.explain()["why_no_alarm"]
    assert [True, True] == [any(line.startswith(word) for line in lines) for word in ("motion: ", "sky: ")]
    player.play(600.0, informative=False, speed_mps=0.0)
    lines = player.explain()["why_no_alarm"]
    assert any("standstill" in line for line in lines)


def test_what_is_kept_is_bounded() -> None:
    """Eleven minutes of driving leave ten minutes of moments, and a document of less than 100 kB."""
    player = Explainer(1.0)
    player.play(660.0)
    document = player.explain()
    assert EXPLANATION.kept == len(document["evidence"])
    assert len(json.dumps(document)) < 100_000


def test_the_command_explains_a_drive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A simulated puncture, replayed: the JSON names wheel, evidence and alternatives; the text says them."""
    folder = tmp_path / "drive"
    flags = ["--duration", "130", "--seed", "3", "--puncture", "rl", "--loss-percent", "2", "--at", "90"]
    flags += ["--over", "5", "--route", "motorway"]
    assert 0 == main(["simulate", str(folder), *flags])
    capsys.readouterr()
    assert 0 == main(["explain", str(folder), "--json", str(tmp_path / "why.json")])
    text = capsys.readouterr().out
    document = json.loads((tmp_path / "why.json").read_text("utf-8"))
    assert "tpmsd.explanation/1" == document["schema"]
    assert {"fl", "fr", "rl", "rr"} == set(document["wheels"])
    assert document["evidence"]
    assert "Each wheel now:" in text


def test_a_drive_that_is_not_there_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 3 and the name."""
    assert 3 == main(["explain", str(tmp_path / "none")])
    assert f"tpmsd: {tmp_path / 'none'}: no such drive folder" == capsys.readouterr().err.strip()


def test_the_socket_explains(tmp_path: Path) -> None:
    """`explain` on the status socket is answered by its own document; a server without one says so."""
    import socket

    for explain, expected in (
        (lambda: {"version": 1, "alarms": []}, {"version": 1, "alarms": []}),
        (None, {"error": "this daemon explains nothing"}),
    ):
        server = StatusServer(tmp_path / "s", lambda: {"version": 1}, explain=explain)
        server.open()
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
            client.settimeout(5)
            client.connect(str(tmp_path / "s"))
            client.sendall(b"explain\n")
            server.service(0.0)
            server.service(0.0)
            assert expected == json.loads(client.recv(65536))
        server.close()


def test_times_are_for_people() -> None:
    """A daemon's times are local, those of a drive count from its start; a cleared alarm clears no more."""
    alarm = {
        "time": 1795521273.2,
        "kind": "malfunction",
        "wheel": None,
        "reason": "no fixes",
        "state": "raised",
    }
    alarms = [
        alarm | {"clears_when": "fixes come"},
        alarm | {"clears_when": "it is cleared", "state": "cleared"},
    ]
    document = {"alarms": alarms, "wheels": {}, "why_no_alarm": [], "alternatives": []}
    zone = timezone(timedelta(hours=2))

    of_daemon = explanation_text(document, zone).splitlines()
    assert "2026-11-24 13:54:33 malfunction raised: no fixes" == of_daemon[0]
    assert "  It clears when fixes come." == of_daemon[1]
    assert "cleared" not in "".join(of_daemon[4:])
    of_drive = explanation_text(document | {"start_time": 1795521200.0}, zone).splitlines()
    assert "1:13.2 malfunction raised: no fixes" == of_drive[0]
