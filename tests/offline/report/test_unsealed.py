"""`tpmsd unseal`: the truth opened, and a report scored against it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.foundation.errors import InputError
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.report.unsealed import score
from tpmsd.offline.simulator.sealed import seal, unseal

SALT = bytes(16)
LATENCY = {"name": "gnss_latency", "parameters": {"latency_s": 0.15}}
LOSS = {"name": "radius_change", "parameters": {"wheel": "rl", "deviation_m": -1.4e-3, "onset_s": 100.0}}


def finding(effect: str, confidence: float = 1.0, **values: Any) -> dict[str, Any]:
    """One of a report; a number comes with its standard deviation."""
    parameters = {
        name: {"value": value[0], "std": value[1]} if isinstance(value, tuple) else {"value": value}
        for name, value in values.items()
    }
    return {"effect": effect, "status": "finding", "confidence": confidence, "parameters": parameters}


def report(*findings: dict[str, Any]) -> dict[str, Any]:
    """A document of `tpmsd diagnose`."""
    return {"schema": "tpmsd.diagnosis/2", "findings": list(findings)}


def truth(*effects: dict[str, Any]) -> dict[str, Any]:
    """What was concealed."""
    return {"onto": "monday", "seed": 1, "effects": list(effects)}


def test_a_right_name_and_a_value_within_its_interval() -> None:
    """0.16 +- 0.01 s holds 0.15 s, 0.16 +- 0.004 s does not."""
    for std, within in ((0.01, True), (0.004, False)):
        made = score(truth(LATENCY), report(finding("gnss_latency", latency_s=(0.16, std))))

        assert (1, 0, True, 0) == tuple(made[key] for key in ("named", "missed", "named_first", "wrong"))
        assert within == made["concealed"][0]["parameters"]["latency_s"]["within"]
        assert (1, int(within)) == (made["values"], made["values_within"])


@pytest.mark.parametrize(
    ("said", "asked"), [({}, 1), ({"course": "ramp"}, 1), ({"course": "exponential"}, 0)]
)
def test_a_time_constant_is_not_compared_with_the_length_of_a_ramp(said: dict[str, str], asked: int) -> None:
    """A report that says nothing of a course means the ramp."""
    loss = {"name": "radius_change", "parameters": {"wheel": "rl", "duration_s": 60.0, "course": "ramp"}}
    made = score(truth(loss), report(finding("radius_change", wheel="rl", duration_s=(61.0, 2.0), **said)))

    assert 1 == made["named"]
    assert (asked, asked) == (made["values"], made["values_within"])


def test_another_wheel_is_a_miss_and_a_wrong_name() -> None:
    """A loss at the left is not found by a loss at the right."""
    made = score(truth(LOSS), report(finding("radius_change", wheel="rr", deviation_m=(-1.4e-3, 1e-4))))

    assert (0, 1, False, 1) == tuple(made[key] for key in ("named", "missed", "named_first", "wrong"))


def test_a_faint_name_that_was_not_concealed_is_not_plainly_wrong() -> None:
    """Below a confidence of 0.9 and as a suspicion it stands there, and is counted apart."""
    doubtful = finding("road_grade") | {"status": "suspicion"}
    made = score(truth(LATENCY), report(finding("antenna_lever_arm", 0.6), doubtful))

    assert ["antenna_lever_arm", "road_grade"] == [one["effect"] for one in made["others"]]
    assert 0 == made["wrong"]


def test_what_the_untouched_recording_holds_is_its_own() -> None:
    """Its findings are not wrong, and its value of the same effect adds to the concealed one."""
    own = report(finding("gnss_latency", latency_s=(0.08, 0.01)), finding("road_grade"))
    said = report(finding("road_grade"), finding("gnss_latency", latency_s=(0.235, 0.01)))
    made = score(truth(LATENCY), said, own)

    assert (1, 0, True) == tuple(made[key] for key in ("named", "wrong", "named_first"))
    assert made["concealed"][0]["parameters"]["latency_s"]["within"]
    assert not score(truth(LATENCY), said)["concealed"][0]["parameters"]["latency_s"]["within"]
    gyro = truth({"name": "yaw_rate_scale", "parameters": {"scale": 1.02}})
    own = report(finding("yaw_rate_scale", scale=(1.01, 1e-3)))
    made = score(gyro, report(finding("yaw_rate_scale", scale=(1.03, 1e-3))), own)
    assert made["concealed"][0]["parameters"]["scale"]["within"]


def test_another_truth_changes_the_score_and_not_the_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The report stays as it is, whatever truth it is held against; a swapped one is told by its hash."""
    file = tmp_path / "report.json"
    file.write_text(json.dumps(report(finding("gnss_latency", latency_s=(0.15, 0.01)))))
    before = file.read_bytes()
    hashes = [seal(tmp_path / str(k), truth(one), SALT) for k, one in enumerate((LATENCY, LOSS))]
    named = []
    for k in (0, 1):
        out = tmp_path / f"score{k}.json"
        words = ["unseal", str(tmp_path / str(k)), "--with", str(file), "--json", str(out)]
        assert 0 == main(words)
        named.append(json.loads(out.read_text())["named"])

    assert [1, 0] == named
    assert before == file.read_bytes()
    assert hashes[0] == hashlib.sha256((tmp_path / "0").read_bytes()).hexdigest()
    assert 3 == main(["unseal", str(tmp_path / "1"), "--with", str(file), "--sha256", hashes[0]])
    assert "another truth than the one that was sealed" in capsys.readouterr().err


def test_people_read_what_was_concealed_beside_what_was_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each effect, its values, what else was named, and the sum."""
    (tmp_path / "out").mkdir()
    seal(tmp_path / "out" / "truth.sealed", truth(LATENCY, LOSS), SALT)
    file = tmp_path / "report.json"
    said = report(finding("gnss_latency", latency_s=(0.2, 0.01)), finding("wheel_lock", wheels="rear"))
    file.write_text(json.dumps(said))

    assert 0 == main(["unseal", str(tmp_path / "out"), "--with", str(file)])

    lines = capsys.readouterr().out.splitlines()[1:]
    assert lines.pop().endswith("diagnose it untouched, and give that report with --untouched")
    assert [
        "  gnss_latency: named, rank 1, confidence 1",
        "      latency_s = 0.15, found 0.2 +- 0.01: outside of the 95 % interval",
        "  radius_change: missed",
        "      wheel = rl",
        "      deviation_m = -0.0014",
        "      onset_s = 100",
        "  wheel_lock (confidence 1): was not concealed",
        "1 of 2 named, 1 missed, 1 wrong above 0.9; 0 of 1 values in their 95 % interval",
    ] == lines


@pytest.mark.parametrize(
    ("text", "code"),
    [("no JSON", 3), ('{"schema": "tpmsd.replay/2"}', 2), ('{"schema": "tpmsd.diagnosis/2"}', 2), ("[1]", 2)],
)
def test_what_is_no_report_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, code: int
) -> None:
    """And the truth is not opened for it."""
    seal(tmp_path / "truth.sealed", truth(LATENCY), SALT)
    (tmp_path / "report.json").write_text(text)

    assert code == main(["unseal", str(tmp_path), "--with", str(tmp_path / "report.json")])
    captured = capsys.readouterr()
    assert "gnss_latency" not in captured.out + captured.err
    assert 1 == len(captured.err.splitlines())


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.binary(max_size=200), st.booleans())
def test_a_broken_seal_is_one_line(tmp_path_factory: pytest.TempPathFactory, data: bytes, head: bool) -> None:
    """Whatever bytes are in the file."""
    path = tmp_path_factory.mktemp("seal") / "truth.sealed"
    path.write_bytes((b"tpmsd sealed truth 1\n" if head else b"") + data)

    with pytest.raises(InputError):
        unseal(path)


def test_a_seal_that_unpacks_without_end_is_refused(tmp_path: Path) -> None:
    """A megabyte is more than any truth."""
    seal(tmp_path / "truth.sealed", {"effects": [], "more": "x" * 3_000_000}, SALT)

    with pytest.raises(InputError):
        unseal(tmp_path / "truth.sealed")
