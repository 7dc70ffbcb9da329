"""The proof: what is sealed stays sealed, and the truth reaches the score alone."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.offline import independent_look
from bench.campaigns.offline.diagnosis.draw import Case, draw_case
from bench.campaigns.offline.diagnosis.make import make
from bench.campaigns.offline.diagnosis.score import match
from bench.campaigns.offline.diagnosis.seal import Answer
from bench.campaigns.offline.diagnosis.truth import Concealed, Truth, truth_of
from bench.campaigns.offline.proof import others as other_methods
from bench.campaigns.offline.proof.oracle import are_identifiable, bounds
from bench.campaigns.offline.proof.others import Said, others
from bench.campaigns.offline.proof.page import page
from bench.campaigns.offline.proof.run import Row, answered, drawn, scored, whole_truth, wrong
from bench.campaigns.offline.proof.seal import BrokenSealError, opened, seal
from bench.worlds import receiver_residuals
from bench.worlds.folder import write_folder
from tpmsd.car.config.load import load_config

SHORT_S = 400.0


def test_a_changed_truth_breaks_the_seal(tmp_path: Path) -> None:
    """A truth that was changed after it was sealed is not opened."""
    sealed = seal({"effect": "gnss_latency"}, "00", tmp_path / "sealed.json")
    assert opened(sealed) == {"effect": "gnss_latency"}
    sealed.file.write_text(sealed.file.read_text(encoding="utf-8").replace("latency", "lateness"))
    with pytest.raises(BrokenSealError):
        opened(sealed)


def shorter(case: Case) -> Case:
    """Return a case with a drive that is long enough for what is asked of it here."""
    return replace(case, spec=replace(case.spec, duration_s=SHORT_S))


def test_swapped_truths_change_the_score_and_not_the_report(tmp_path: Path) -> None:
    """With another drive's truth beside it the report is the same, and the score is not."""
    case, other = (shorter(draw_case(name, 1.0, 7)) for name in ("centrifugal_growth", "gnss_latency"))
    made = make(case, tmp_path)
    drive, sealed = tmp_path / "drive", tmp_path / "sealed-1.json"
    write_folder(made.drive, drive)
    right = truth_of(case, made.windows)
    swapped = truth_of(other, make(other, tmp_path).windows)
    documents: list[Answer] = []
    rows: list[Row] = []
    for truth in (right, swapped):
        kept = seal(truth.plain(), "00", sealed)
        answer, _ = answered(drive, drive.with_suffix(".svg"), 1, False)
        documents.append(answer)
        rows.append(scored(case, made, Truth.of(opened(kept)), answer, {}, kept.sha256))
    assert documents[0].document["findings"] == documents[1].document["findings"]
    assert documents[0].model == documents[1].model
    assert [row.hit for row in rows] == [True, False]
    assert [row.wrong for row in rows] == [False, True]
    assert rows[0].named == rows[1].named


def test_an_age_that_all_counts_share_makes_no_wrong_name(tmp_path: Path) -> None:
    """Seed 1 has a control unit that latches its counts every 16.5 ms, and warm-up: that alone is named.

    Such an age once passed for a receiver whose speed is half a second old."""
    case = next(case for case in drawn(1, tmp_path) if case.kind == "latched/thermal_growth")
    assert case.spec.latch_period_s == pytest.approx(0.0165, rel=0.01)
    made, drive = make(case, tmp_path), tmp_path / "drive"
    write_folder(made.drive, drive)
    answer, _ = answered(drive, drive.with_suffix(".svg"), 1, False)
    row = scored(case, made, whole_truth(case, made), answer, {}, "")
    assert (row.hit, row.wrong) == (True, False)
    assert "warming up" in row.said
    assert drive.with_suffix(".svg").read_text(encoding="utf-8").count("<svg") == 1


def test_the_lag_of_a_drawn_receiver_is_sealed_and_not_asked_for(tmp_path: Path) -> None:
    """A drawn velocity lag is part of the sealed truth, and finding it makes no wrong name."""
    case = draw_case("nothing", 0.0, 7)
    case = replace(case, spec=replace(case.spec, doppler_age_s=0.08))
    truth = whole_truth(case, make(case, tmp_path))
    assert [(each.effect, each.inherent) for each in truth.effects] == [("velocity_lag", True)]
    assert match(truth, [{"effect": "velocity_lag", "parameters": {}}]) == [0]


def recorded(folder: Path) -> Path:
    """Make a folder with the names of the recordings that an origin draws errors from."""
    for name in receiver_residuals.DEVELOPMENT:
        (folder / name).mkdir(parents=True)
    return folder


def test_a_seed_draws_the_same_cases_again(tmp_path: Path) -> None:
    """A seed draws distinct effects and one null drive, and the same ones every time."""
    kinds = [case.kind.rpartition("/")[2] for case in drawn(3, tmp_path)]
    assert [case.key for case in drawn(3, tmp_path)] == [case.key for case in drawn(3, tmp_path)]
    assert len(set(kinds)) == len(kinds) and "nothing" in kinds
    assert [case.key for case in drawn(3, tmp_path)] != [case.key for case in drawn(4, tmp_path)]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_recordings_are_needed(seed: int, tmp_path: Path) -> None:
    """Without recordings a road and a receiver that are made up replace recorded errors, and nothing else."""
    with_them = [case.kind for case in drawn(seed, recorded(tmp_path / "recordings"))]
    without = [case.kind for case in drawn(seed, tmp_path / "none")]

    assert [kind.removeprefix("receiver/") for kind in with_them] == without


def test_another_method_is_right_where_residual_and_covariate_are() -> None:
    """A formula locates an effect only by a residual and a covariate in which the effect acts."""
    said = Said("rl", "speed", "+0.4 speed", 0.2)
    assert said.locates(["wheel"], ["rl", "rr"], ["speed"])
    assert not said.locates(["wheel"], ["fl"], ["speed"])
    assert not said.locates(["wheel"], ["rl"], ["time"])
    assert said.locates(["gnss_course"], [], ["speed"])
    assert not Said("gyro", "time", "", 0.2).locates(["gnss_course"], ["rl"], ["time"])


def test_a_drive_without_course_is_no_end_of_the_proof(tmp_path: Path) -> None:
    """Without a reported course the other methods get the remaining windows, or say that they fail."""
    case = shorter(draw_case("nothing", 0.0, 7))
    drive = tmp_path / "drive"
    write_folder(make(case, tmp_path).drive, drive)
    file = drive / "gnss.nmea"
    file.write_text("\n".join(map(without_course, file.read_text("ascii").splitlines())) + "\n", "ascii")
    said = others(drive, 1)
    assert set(said) == {"PySINDy", "gplearn"}
    assert np.isfinite(independent_look.read(drive, load_config(drive / "vehicle.toml")).speed).any()


def without_course(line: str) -> str:
    """A logged sentence less the course over ground of RMC."""
    head, found, body = line.partition("$")
    fields = body.partition("*")[0].split(",")
    if not found or not fields[0].endswith("RMC"):
        return line
    fields[8] = ""
    text = ",".join(fields)
    return f"{head}${text}*{functools.reduce(lambda sum_, each: sum_ ^ ord(each), text, 0):02X}"


def test_a_method_that_fails_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An error of another method stands in its row, and ends nothing."""

    def failing(folder: Path) -> None:
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr(other_methods, "table", failing)
    monkeypatch.setattr(other_methods, "find_spec", lambda name: name)
    assert {"failed: singular"} == {one.error for one in others(tmp_path, 1).values()}


def test_misses_stand_on_the_page_beside_hits() -> None:
    """The page says of every drive if it was a hit, a miss or a wrong name, with markup escaped."""
    rows = [Row("a", "x", hit=True), Row("b", "y<z", identifiable=False), Row("c", "z", wrong=True)]
    rows += [Row("d", "nothing", hit=True), Row("e", "slope", hit=True, known=True)]
    text = page(rows, 5)
    assert "1 of 2 concealed effects that their drives identify are named first, 1 of 3 in all" in text
    assert "1 drive with a wrong name" in text and "y&lt;z" in text
    assert all(f"{row.drive}: {row.verdict}" in text for row in rows) and "SEED=5" in text
    assert 'data-head="verdict"' in text, "on a phone each cell has the head of its column"


def test_a_finding_that_nobody_concealed_is_explained() -> None:
    """A drawn receiver's lag is on the page as what the drive holds besides, and text has the page's sign."""
    row = Row("a", "nothing", hit=True, inherent="velocity_lag lag_s 0.09", value="lag_s 0.09 +- 0.01")
    text = page([row], 1)
    assert "<dt>also there, part of the receiver, not scored</dt><dd>velocity_lag lag_s 0.09</dd>" in text
    assert "0.09 ± 0.01" in text and "+-" not in text


def test_verdict_and_picture_stand_before_the_table() -> None:
    """The order is verdict, picture of the first hit with what was said of it, table, each drive."""
    rows = [Row("a", "x", picture="<svg/>"), Row("b", "y", hit=True, said="It is +- y.", picture="<svg/>")]
    text = page(rows, 1)
    order = [text.index(mark) for mark in ("<h1>", "<figure>", "It is ± y.", "<table>", "<article")]
    assert order == sorted(order)
    assert text.count("<figure>") == 1


def test_the_oracle_asks_for_gain_and_for_margin() -> None:
    """An effect counts as identifiable with 64 nats, 8 of them beyond its best alternative."""
    effect = Concealed("x", "x", {}, 64.0, 8.0, "y", [], [], [], [])
    assert are_identifiable([effect])
    assert not are_identifiable([effect, replace(effect, gain=63.9)])
    assert not are_identifiable([replace(effect, margin=7.9)])
    assert bounds([effect]) == "64 nats, 8 more than y"


def test_the_oracle_tells_a_larger_effect_and_not_a_smaller_one(tmp_path: Path) -> None:
    """The gain goes with the square of the size: at an eighth growth is not identifiable."""
    made = [draw_case("centrifugal_growth", strength, 7) for strength in (1.0, 0.125)]
    large, small = (truth_of(case, make(case, tmp_path).windows).effects for case in made)
    assert are_identifiable(large)
    assert not are_identifiable(small)


def test_the_oracle_knows_the_split_of_a_drive_as_rival_of_shifted_load(tmp_path: Path) -> None:
    """On a car that drives all wheels both act alike; on others the drive has no split."""
    case = draw_case("load_transfer_longitudinal", 1.0, 7)
    for driven, split in (("all", True), ("front", False)):
        made = make(replace(case, spec=replace(case.spec, driven=driven)), tmp_path)
        (effect,) = truth_of(case, made.windows).effects
        assert (effect.alternative == "drive_split") is split
        assert are_identifiable([effect]) is not split


@pytest.mark.parametrize(
    ("confidence", "beside", "judged"), [(0.95, ["x"], True), (0.6, ["x"], False), (0.6, ["z"], True)]
)
def test_an_unsure_name_is_not_wrong_beside_the_true_one(
    confidence: float, beside: list[str], judged: bool
) -> None:
    """Above 0.9 a wrong name is wrong; below, where the true one is not listed beside it."""
    effect = Concealed("x", "x", {}, 64.0, 8.0, "y", [], [], [], [])
    finding = {"effect": "y", "confidence": confidence, "indistinguishable_from": beside}
    assert wrong(finding, [effect]) is judged
