"""Several drives of one car, diagnosed together."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.prepared.admission import fair_shares, limited_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.inference.least_squares import Evidence, part
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader


def recorded(name: str, seed: int, duration_s: float = 200.0, **physics: dict[str, object]) -> Recording:
    """A drive of this name that conceals this physics; wheels' radii are drawn by the seed."""
    made = recording_of(drive(Spec(duration_s=duration_s, physics=physics), seed))
    return dataclasses.replace(made, name=name)


def test_two_drives_tell_what_neither_tells_alone() -> None:
    """An effect too faint for each of two short drives is named and measured by both together."""
    truth = 7e-6
    drives = [recorded(name, seed, 150.0, load_transfer_lateral={"coefficient": truth}) for name, seed in _AB]
    alone = [diagnose([one]).verdict for one in drives]
    (finding,) = diagnose(drives).findings
    value = finding.parameters["coefficient"]

    assert ["consistent", "consistent"] == alone
    assert ("load_transfer_lateral", ()) == (finding.effect, finding.drives)
    assert isinstance(value.value, float)
    assert value.std is not None
    assert abs(value.value - truth) < 3 * value.std


_AB = (("a", 65), ("b", 66))


def test_a_leak_belongs_to_the_drive_in_which_it_happened() -> None:
    """Wheel, onset since that drive's start and its name are told; the model of the car holds no leak."""
    leak = {"wheel": "fr", "deviation_m": -1e-3, "onset_s": 90.0, "duration_s": 30.0}
    diagnosis = diagnose([recorded("a", 36, 300.0), recorded("b", 37, radius_change=leak)])
    (finding,) = diagnosis.findings

    assert ("radius_change", ("b",)) == (finding.effect, finding.drives)
    assert "fr" == finding.parameters["wheel"].value
    assert finding.parameters["deviation_m"].value == pytest.approx(-1e-3, rel=0.05)
    assert finding.where.time_spans[0] == pytest.approx((90.0, 200.0), abs=5.0)
    assert () == diagnosis.model.effects


def test_radii_that_differ_from_drive_to_drive_are_calibration() -> None:
    """Tyres changed in between: another constant radius on every wheel is no finding."""
    diagnosis = diagnose([recorded("a", 31), recorded("b", 32), recorded("c", 33)])

    assert ("consistent", ()) == (diagnosis.verdict, diagnosis.findings)


def test_a_value_that_is_each_drives_own_is_reported_as_that() -> None:
    """Gyro biases of two drives are a finding for each, and nothing else is made of them."""
    truth = {"a": 2e-3, "b": -1.5e-3}
    drives = [
        recorded(name, seed, yaw_rate_bias={"bias": truth[name]}) for name, seed in (("a", 41), ("b", 42))
    ]
    findings = diagnose(drives).findings
    found = {finding.drives: finding for finding in findings}

    assert {"yaw_rate_bias"} == {finding.effect for finding in findings}
    assert {("a",), ("b",)} == set(found)
    for name, bias in truth.items():
        assert found[(name,)].parameters["bias"].value == pytest.approx(bias, abs=1.5e-4)


def test_drives_of_different_cars_are_refused() -> None:
    """Another wheelbase in the configuration is an error that names both drives and the lengths."""
    other = recording_of(drive(Spec(duration_s=100.0, wheelbase_m=2.9), 1))
    with pytest.raises(
        ConfigError, match=r"^a and b are drives of different cars: wheelbase_m = 2.7 and 2.9$"
    ):
        diagnose([recorded("a", 2, 100.0), dataclasses.replace(other, name="b")])


def test_an_unfit_drive_is_left_out_and_named() -> None:
    """A drive of a minute is left out with the reason; the other is diagnosed as if it were alone."""
    good = recorded("good", 31)
    diagnosis = diagnose([good, recorded("short", 32, 60.0)])

    assert ("short: left out, for the drive is shorter than 90 s",) == diagnosis.notes
    assert diagnose([good]).baseline_rms == diagnosis.baseline_rms


def test_of_too_much_driving_every_drive_keeps_stretches_all_over() -> None:
    """Of 200 windows the short drive gets all it has, and the long one's share begins at its start."""
    drives = [recorded("long", 61, 400.0), recorded("short", 62, 100.0)]
    readers = [Reader(one, reference(one)) for one in drives]
    (long, short), notes = limited_readers(readers, windows=200)
    index, whole = long.windows.index, readers[0].windows.index

    assert len(readers[1].windows) == len(short.windows)
    assert 200 == len(long.windows) + len(short.windows)
    assert whole[0] == index[0]
    assert [
        f"long: of {len(whole)} s of driving, {len(index)} s in stretches spread over the drive were examined"
    ] == notes
    assert ["a", "b"] == [one.recording.name for one in limited_readers(_named("a", "b", "c"), drives=2)[0]]


def _named(*names: str) -> list[Reader]:
    """Readers of drives that last shorter and shorter."""
    drives = [recorded(name, 63, 140.0 - 20.0 * k) for k, name in enumerate(names)]
    return [Reader(one, reference(one)) for one in drives]


def test_the_first_noise_of_several_drives_is_estimated_beside_nothing_rare() -> None:
    """As that of one drive is: the fullest model leaves what few drives show."""
    hypotheses = Regression(_named("a", "b")).hypotheses
    rare = [t for t in hypotheses.catalogue if t.kind_of.confounding.rare and t.design.shape[1] == 1]
    fullest = hypotheses.fullest_design

    assert rare
    for term in rare:
        assert not np.any(np.all(fullest == term.design, axis=0))


@given(st.lists(st.integers(0, 5000), min_size=1, max_size=12), st.integers(12, 9000))
def test_shares_are_fair(wanted: list[int], total: int) -> None:
    """None gets more than it wants, all is given out, and who is cut short gets as much as any."""
    shares = fair_shares(wanted, total)
    cut = [share for share, want in zip(shares, wanted, strict=True) if share < want]

    assert all(share <= want for share, want in zip(shares, wanted, strict=True))
    assert sum(shares) == min(total, sum(wanted))
    assert all(share >= max(shares) - 1 for share in cut)


def test_a_held_out_drive_is_predicted_by_the_others_and_their_doubt() -> None:
    """Its score is the normal density under the value that the others tell, and that value's variance."""
    rng = np.random.default_rng(8)
    blocks = np.repeat(np.arange(10), 4)
    rows = rng.standard_normal((3, 40, 9, 2)) * (1.0, 0.1)
    rows[..., 0] += 0.8 * rows[..., 1]
    evidence = Evidence([part(one, blocks) for one in rows], 2)
    flat = rows.reshape(3, -1, 2)
    total = float((flat[..., 1] ** 2).sum())
    expected = []
    for k in range(3):
        others = np.delete(flat, k, axis=0).reshape(-1, 2)
        # Where nobody knows anything the value is as uncertain as one of the 900 windows would leave it.
        information = float((others[:, 1] ** 2).sum()) + total / 900.0
        value = float((others[:, 0] * others[:, 1]).sum()) / information
        y, x = flat[k].T
        density = multivariate_normal(x * value, np.eye(len(x)) + np.outer(x, x) / information)
        expected.append(float(density.logpdf(y)) + 0.5 * len(x) * np.log(2 * np.pi))

    scores = evidence.heldout(evidence.unit(1)).reshape(3, 10).sum(axis=1)
    assert scores == pytest.approx(expected, rel=1e-6)
