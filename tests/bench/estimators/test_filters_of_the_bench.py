"""What the bench itself computes: the limit, the library's filter, the compiled kernel, batches, survival."""

from __future__ import annotations

import json
from dataclasses import asdict, astuple, replace
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.onboard.estimators.batches import Radii, play_batch
from bench.campaigns.onboard.estimators.kernel import Kernel, compile_kernel
from bench.campaigns.onboard.estimators.library import LibraryAugPf
from bench.campaigns.onboard.estimators.limit import limit
from bench.campaigns.onboard.estimators.methods import (
    INPUTS,
    POSITIONS,
    SAMPLED,
    TEXTBOOK,
    WANTED,
    build,
    config_of,
)
from bench.campaigns.onboard.estimators.play import difference, play
from bench.campaigns.onboard.estimators.recordings import dropped, own_difference_m
from bench.campaigns.onboard.estimators.report import _fig10
from bench.campaigns.onboard.estimators.run import earlier, play_all
from bench.campaigns.onboard.estimators.survive import legs
from bench.campaigns.onboard.estimators.tasks import Task
from bench.cli import main, parse
from bench.worlds.paper_drive import PUNCTURE_M, RADIUS_M, RL, RR, SCENARIOS, Driven, drive
from tests.bench.estimators.drives import RURAL, piece
from tpmsd.car.config.model import FilterConfig
from tpmsd.onboard.estimators.published.radius_models import NiwRadii

UNBALANCED_MM = -1.5


@pytest.fixture(scope="module")
def rural() -> Driven:
    return drive(SCENARIOS["unbalanced"], "white", 2, piece(*RURAL))


def mean_mm(values: np.ndarray) -> float:
    """Over the last 40 s."""
    return 1e3 * float(np.mean(values[-400:]))


def test_the_smoother_knows_more_than_the_filter_and_both_are_truthful() -> None:
    """Later data never widen a smoothed variance, and NEES of the pair is about 2 over some drives."""
    nees = []
    for seed in range(8):
        driven = drive(SCENARIOS["unbalanced"], "correlated", seed, piece(RURAL[0], RURAL[0] + 60.0))
        found = limit(driven)
        assert np.all(
            np.einsum("kii->ki", found.smoothed_cov) <= np.einsum("kii->ki", found.causal_cov) + 1e-12
        )
        error = (found.causal_m - driven.offsets_m[:, RL:])[-1]
        nees.append(error @ np.linalg.solve(found.causal_cov[-1], error))
    # eight values of chi-square with 2 degrees of freedom: their mean lies within 0.5 and 4.9 in 99.7 %
    assert 0.5 < float(np.mean(nees)) < 4.9


def test_at_the_last_tick_smoother_and_filter_say_the_same(rural: Driven) -> None:
    """There are no later data."""
    found = limit(rural)
    np.testing.assert_array_equal(found.causal_m[-1], found.smoothed_m[-1])


def test_the_librarys_filter_finds_the_difference(rural: Driven) -> None:
    """-1.5 mm to 0.3 mm."""
    other = LibraryAugPf(rural.ticks, 500, seed=3)
    said = np.array([other.step()[0] for _ in rural.ticks[other.first :]])
    assert pytest.approx(UNBALANCED_MM, abs=0.3) == mean_mm(said)


def test_batches_and_kernel_and_the_programs_filter_agree(rural: Driven) -> None:
    """Three codes of the textbook MPF-PN on the same drive: each to 0.3 mm of the truth."""
    ours = play(build(TEXTBOOK, 500, 1), rural.ticks)
    assert pytest.approx(UNBALANCED_MM, abs=0.3) == mean_mm(difference(ours.rear_m))
    rng = np.random.default_rng(4)
    runs = play_batch(Radii(NiwRadii(1.0 - 1.0 / 600), 4 * 200, rng), [rural.ticks] * 4, 200, rng)
    for run in runs:
        assert pytest.approx(UNBALANCED_MM, abs=0.3) == mean_mm(difference(run.rear_m))
    library = compile_kernel()
    if isinstance(library, str):
        pytest.skip(library)
    kernel = Kernel(library, 500, seed=5)
    said = np.array([kernel.step(tick) for tick in rural.ticks])
    assert pytest.approx(UNBALANCED_MM, abs=0.3) == mean_mm(said[:, 0] - said[:, 1])
    # the stated errors are of one size too: the mathematics, not only the centre, is the same
    variance = ours.covariance_m2
    stated = np.sqrt(variance[:, 0, 0] + variance[:, 1, 1] - 2 * variance[:, 0, 1])
    assert pytest.approx(mean_mm(stated), rel=0.5) == mean_mm(said[:, 2])


def test_the_kernels_random_numbers_have_the_right_moments() -> None:
    """Normal: 0, 1, kurtosis 3 and the tail beyond the ziggurat's base; chi-square: k and 2 k."""
    library = compile_kernel()
    if isinstance(library, str):
        pytest.skip(library)
    kernel = Kernel(library, 10, seed=1)
    normal = kernel.draws(0, 0.0, 400_000)
    assert pytest.approx(0.0, abs=0.008) == float(normal.mean())
    assert pytest.approx(1.0, abs=0.012) == float(normal.var())
    assert pytest.approx(3.0, abs=0.05) == float((normal**4).mean())
    assert pytest.approx(5.76e-4, rel=0.3) == float((np.abs(normal) > 3.4426).mean())
    for dof in (3.0, 500.0):
        square = kernel.draws(1, dof, 200_000)
        assert pytest.approx(dof, rel=0.02) == float(square.mean())
        assert pytest.approx(2 * dof, rel=0.03) == float(square.var())


def test_without_a_compiler_a_line_says_so() -> None:
    """The bench goes on without the kernel."""
    said = compile_kernel(compilers=("no-such-compiler",))
    assert isinstance(said, str)
    assert "no C compiler" in said


def test_chords_find_the_tyres_own_difference(rural: Driven) -> None:
    """Without any filter; the standard error is truthful within a factor of three."""
    config = config_of("gaussian-sum")
    found, std = own_difference_m(rural.ticks, config)
    assert abs(1e3 * found - UNBALANCED_MM) < 3 * 1e3 * std
    assert std < 2e-3


def test_an_injected_drop_is_what_another_radius_would_have_turned(rural: Driven) -> None:
    """Rotation times the smaller radius is the same way, eq. (39); the left wheel is left alone."""
    ticks, delta = dropped(tuple(rural.ticks), RADIUS_M)
    assert pytest.approx(PUNCTURE_M) == delta[-1]
    before, after = rural.ticks[-1].rotation_rad, ticks[-1].rotation_rad
    assert pytest.approx(before[RR] * RADIUS_M) == after[RR] * (RADIUS_M + PUNCTURE_M)
    assert before[RL] == after[RL]


@pytest.mark.parametrize("inputs", INPUTS)
def test_every_method_has_the_products_settings_and_equal_inputs(inputs: str) -> None:
    """But for method, rate and particles the configuration is the default one, and all methods hear the
    same."""
    for method in WANTED:
        config = config_of(method, 500 if method in SAMPLED else None, inputs=inputs).filter
        usual = FilterConfig(method=method, rate_hz=10.0, particles=config.particles)
        assert replace(config, measurements=usual.measurements) == usual
        assert config.measurements == INPUTS[inputs]


def test_hours_of_driving_join_without_a_jump() -> None:
    """Each leg begins where and when the one before ended; time only ever rises; faults are in it."""
    first, second = islice(legs(1), 2)
    ticks = first[0] + second[0]
    assert all(a.time_s < b.time_s for a, b in pairwise(ticks))
    last = next(t.fixes[0] for t in reversed(first[0]) if t.fixes)
    begin = next(t.fixes[0] for t in second[0] if t.fixes)
    assert np.hypot(last.east_m - begin.east_m, last.north_m - begin.north_m) < 15.0
    assert any(np.isnan(t.rotation_rad).all() for t in ticks)
    assert any(t.gap_s > 0.0 for t in ticks)
    assert len(first[0]) == len(first[1])


@pytest.mark.parametrize(
    "bad",
    [["--only", "runs,figs"], ["--runs", "0"], ["--survive", "-1"], ["--methods", "mpf-xy"], ["--nothing"]],
)
def test_a_wrong_command_line_ends_with_exit_code_two(bad: list[str]) -> None:
    """argparse's own."""
    with pytest.raises(SystemExit) as ended:
        main(["run", "estimators", *bad])
    assert ended.value.code == 2


def test_the_bench_writes_its_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without recordings nothing but the head is left to say, and nothing fails."""
    arguments = ["--only", "recordings", "--jobs", "1", "--recordings", str(tmp_path), "--out", str(tmp_path)]
    assert main(["run", "estimators", *arguments]) == 0
    assert "Commit " in capsys.readouterr().out
    assert (tmp_path / "results.md").exists()


def test_methods_that_never_diverged_are_in_a_sentence() -> None:
    """A method with a run that diverged has a row, by number of particles."""
    run = {"scenario": "puncture", "receiver": "white", "front": False, "inputs": POSITIONS}
    rows = [run | {"method": "mpf-mn", "particles": 500, "diverged": why} for why in ("", "place lost")]
    text = "\n".join(_fig10([*rows, run | {"method": "aug-ekf", "particles": 0, "diverged": ""}]))

    assert "| mpf-mn | white |  | 1/2 |  |  |" in text
    assert "No run diverged of aug-ekf (white)." in text


def test_parts_of_another_state_of_the_program_are_not_kept(tmp_path: Path) -> None:
    """Nor is what cannot be read."""
    file = tmp_path / "results.json"
    assert earlier(file, "abc") == {}
    file.write_text(json.dumps({"commit": "abc", "rows": [1]}), encoding="utf-8")
    assert earlier(file, "abc")["rows"] == [1]
    assert earlier(file, "abd") == {}


def test_a_run_that_was_done_is_not_done_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its row is read from the file, at the same commit only; a line cut short does no harm."""
    args = parse(["run", "estimators", "--out", str(tmp_path), "--jobs", "1"])
    task = Task("puncture", "white", 0, "gaussian-sum", 0)
    row = {**asdict(task), "rmse_difference_m": 0.5}
    entry = {"unit": list(astuple(task)), "state": "abc", "result": row}
    lines = [json.dumps(entry), '{"unit": ["pu']
    (tmp_path / "rows.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert play_all([task], args, "abc") == [row]
    assert "1 of 1 stand in" in capsys.readouterr().err
