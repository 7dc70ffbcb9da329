"""When the learned state is saved, and when it is taken up."""

from __future__ import annotations

import hashlib
import json
import logging
import subprocess
import sys
import threading
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.onboard.daemon.fakes import car
from tpmsd.car.config.model import Config
from tpmsd.onboard.daemon.state_keeper import StateKeeper, fingerprint
from tpmsd.onboard.daemon.state_writer import StateWriter
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sinks.state_file import load_state, save_state, write_state

LOG = logging.getLogger("tests.state")


def saved(config: Config) -> Any:
    assert config.state.file is not None
    payload = load_state(config.state.file)
    return None if payload is None else payload["pipeline"]


class PromptWriter(StateWriter):
    """A disk that is done at once."""

    def begin(self, file: Path, content: bytes) -> None:
        """Write, and wait for it."""
        super().begin(file, content)
        self._done.wait()


def keeper(folder: Path) -> tuple[StateKeeper, Config]:
    config, _ = car(folder)
    return StateKeeper(config, LOG, PromptWriter()), config


def test_a_disk_that_hangs_holds_up_nobody(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """While a write hangs the loop goes on; what changes in this time is saved after it."""
    config, _ = car(tmp_path)
    go_on, begun = threading.Event(), []

    def write(file: Path, content: bytes) -> None:
        begun.append(content)
        go_on.wait(60.0)
        write_state(file, content)

    state = StateKeeper(config, LOG, StateWriter(write))
    state.service(0.0, lambda: {"n": 0})
    for now_s in range(60, 400):
        state.service(float(now_s), lambda now_s=now_s: {"n": now_s})  # type: ignore[misc]
        state.request_save()
    state.save(400.0, {"n": 400}, wait_s=0.01)
    assert (1, None) == (len(begun), saved(config))
    assert [f"{config.state.file}: not saved: the disk does not answer"] == caplog.messages
    go_on.set()
    while saved(config) != {"n": 401}:
        state.service(401.0, lambda: {"n": 401})
    assert 2 == len(begun)


def test_a_write_that_hangs_is_not_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A writer is busy, and its write not over, until the disk has answered; then it is over once. Who does
    not say how long is not kept waiting."""
    go_on = threading.Event()
    writer = StateWriter(lambda file, content: (go_on.wait(60.0), None)[1])
    writer.begin(tmp_path / "state.json", b"")
    waited, wait = list[float](), writer._done.wait

    def patient(seconds: float) -> bool:
        waited.append(seconds)
        return wait(seconds)

    monkeypatch.setattr(writer._done, "wait", patient)
    assert (False, False, True) == (writer.finished(), writer.finished(0.01), writer.busy)
    assert waited == [0.0, 0.01]
    go_on.set()
    assert (True, False) == (writer.finished(60.0), writer.busy)


def test_without_memory_for_a_thread_the_state_is_saved_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where no thread can be started the write is made in the loop."""
    monkeypatch.setattr(threading.Thread, "start", lambda _: (_ for _ in ()).throw(RuntimeError("no thread")))
    state, config = keeper(tmp_path)
    state.save(0.0, {"n": 1})
    assert {"n": 1} == saved(config)


def test_a_disk_that_hangs_for_ever_keeps_no_process_from_its_end(tmp_path: Path) -> None:
    """The interpreter does not wait for a write that never comes back."""
    program = (
        "import sys, threading\n"
        "from pathlib import Path\n"
        "from tpmsd.onboard.daemon.state_writer import StateWriter\n"
        "StateWriter(lambda file, content: threading.Event().wait()).begin(Path(sys.argv[1]), b'')\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "state.json")]
    assert 0 == subprocess.run(command, timeout=20.0).returncode


def test_whatever_a_write_raises_is_a_failure(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A write that ends in an exception of any type is said, is not taken for saved, and is tried again."""
    config, _ = car(tmp_path)
    failures: list[Exception] = [MemoryError(), ValueError("a defect")]

    def write(file: Path, content: bytes) -> None:
        if failures:
            raise failures.pop(0)
        write_state(file, content)

    state, seen = StateKeeper(config, LOG, StateWriter(write)), []
    for now_s in (0.0, 60.0, 120.0):
        state.save(now_s, {"n": 1})
        seen.append(saved(config))

    assert [None, None, {"n": 1}] == seen
    cannot = f"{config.state.file}: cannot save the state: MemoryError: ; trying again later"
    assert [cannot] == caplog.messages


def test_the_state_is_saved_at_its_interval(tmp_path: Path) -> None:
    """Sixty seconds after the start, and then every sixty, what is learned goes to the disk."""
    state, config = keeper(tmp_path)
    seen = []
    for now_s in range(200):
        state.service(float(now_s), lambda now_s=now_s: {"learned": now_s})  # type: ignore[misc]
        seen.append(saved(config))

    assert [None, {"learned": 60}, {"learned": 120}, {"learned": 180}] == [
        value for k, value in enumerate(seen) if k == 0 or value != seen[k - 1]
    ]


def test_a_state_that_cannot_be_set_aside_says_why(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A folder stands under the name: the reason of the system, without its number and without paths."""
    config, database = car(tmp_path)
    assert config.state.file is not None
    StateKeeper(config, LOG).save(0.0, {"format": "nonsense"})
    (tmp_path / "state.json.other" / "full").mkdir(parents=True)
    StateKeeper(config, LOG).restored(lambda: Pipeline(config, database))
    (said,) = caplog.messages
    assert said.endswith("; could not be set aside (Is a directory), learning again")


@pytest.mark.parametrize("start_s", [0.5, 60.0, 1e6])
def test_the_first_moment_saves_nothing_whatever_the_clock_shows(start_s: float, tmp_path: Path) -> None:
    """Monotonic time counts from the machine's start: the interval begins with the first service."""
    state, config = keeper(tmp_path)
    state.service(start_s, lambda: {"n": 0})
    state.service(start_s + 59.0, lambda: {"n": 1})
    assert saved(config) is None
    state.service(start_s + 60.0, lambda: {"n": 2})
    assert {"n": 2} == saved(config)


def test_an_alarm_is_saved_at_once_but_not_each_of_many(tmp_path: Path) -> None:
    """An alarm goes to the disk with the next tick; those that follow wait until five seconds have passed."""
    state, config = keeper(tmp_path)
    state.service(0.0, lambda: {"n": 0})
    seen = []
    for step in range(100):
        now_s = 10.0 + 0.1 * step
        state.request_save()
        state.service(now_s, lambda step=step: {"n": step})  # type: ignore[misc]
        seen.append(saved(config)["n"])

    assert [0, 50] == sorted(set(seen))


def test_what_has_not_changed_is_not_written_again(tmp_path: Path) -> None:
    """A parked car does not wear the flash."""
    state, config = keeper(tmp_path)
    assert config.state.file is not None
    state.save(0.0, {"n": 1})
    first = config.state.file.stat()
    state.save(60.0, {"n": 1})

    assert first.st_ino == config.state.file.stat().st_ino


def test_a_disk_that_fails_is_tried_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A state that cannot be written is said once; when it can be, that is said too."""
    caplog.set_level(logging.INFO)
    config, _ = car(tmp_path / "car")
    config = replace(config, state=replace(config.state, file=tmp_path / "gone" / "state.json"))
    (tmp_path / "gone").write_text("a file where a folder should be")
    state = StateKeeper(config, LOG)
    for now_s in (0.0, 60.0, 120.0):
        state.save(now_s, {"n": now_s})
    (tmp_path / "gone").unlink()
    state.save(180.0, {"n": 180.0})

    assert {"n": 180.0} == saved(config)
    assert 2 == len(caplog.messages)
    assert caplog.messages[0].endswith("; trying again later")
    assert caplog.messages[1].endswith("saved again")


def test_an_alarm_that_could_not_be_saved_is_tried_again_soon(tmp_path: Path) -> None:
    """What is urgent stays urgent over a failure: it is written five seconds later, not after a minute."""
    config, _ = car(tmp_path / "car")
    config = replace(config, state=replace(config.state, file=tmp_path / "gone" / "state.json"))
    (tmp_path / "gone").write_text("a file where a folder should be")
    state = StateKeeper(config, LOG, PromptWriter())
    state.service(0.0, lambda: {"n": 0})
    state.request_save()
    state.service(10.0, lambda: {"n": 1})
    (tmp_path / "gone").unlink()
    for now_s in np.arange(10.1, 16.0, 0.1):
        state.service(float(now_s), lambda: {"n": 1})

    assert {"n": 1} == saved(config)


def test_each_failure_of_the_disk_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A disk that fails, works and fails again is reported both times."""
    caplog.set_level(logging.INFO)
    state, config = keeper(tmp_path)
    assert config.state.file is not None
    for n, works in enumerate((False, False, True, True, False, False, True)):
        if not works and not config.state.file.is_dir():
            config.state.file.unlink(missing_ok=True)
            config.state.file.mkdir()
        elif works and config.state.file.is_dir():
            config.state.file.rmdir()
        state.save(60.0 * n, {"n": n})

    assert ["later", "again", "later", "again"] == [message.split()[-1] for message in caplog.messages]


class HalfRestored:
    """A pipeline that fails in the middle of taking up a snapshot."""

    def __init__(self, error: Exception) -> None:
        self._error = error
        self.changed = False

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up half of it."""
        self.changed = True
        raise self._error


@pytest.mark.parametrize(
    "error",
    [
        *(ValueError("n"), KeyError("n"), IndexError(), TypeError("n"), AttributeError("n")),
        *(OverflowError("n"), ZeroDivisionError("n"), np.linalg.LinAlgError("n")),
    ],
    ids=lambda error: type(error).__name__,
)
def test_whatever_a_snapshot_breaks_is_made_anew(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, error: Exception
) -> None:
    """A snapshot by which restoring fails is set aside with one line; a pipeline without any of it runs."""
    state, config = keeper(tmp_path)
    state.save(0.0, {"n": 1})
    pipeline = StateKeeper(config, LOG).restored(lambda: HalfRestored(error))  # type: ignore[return-value, arg-type]

    assert not pipeline.changed  # type: ignore[attr-defined]
    assert (tmp_path / "state.json.other").is_file()
    assert [True] == ["does not fit: " in message for message in caplog.messages]


def test_the_state_of_another_car_is_set_aside(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Radii learned with other nominal radii or signals are useless: one line, and learning begins again."""
    config, database = car(tmp_path)
    pipeline = Pipeline(config, database)
    StateKeeper(config, LOG).save(0.0, pipeline.snapshot())
    other = replace(config, vehicle=replace(config.vehicle, wheel_radius_m=(0.33,) * 4))
    StateKeeper(other, LOG).restored(lambda: Pipeline(other, database))

    assert fingerprint(config) != fingerprint(other)
    assert config.state.file is not None
    assert not config.state.file.exists()
    assert (tmp_path / "state.json.other").is_file()
    assert [
        f"{config.state.file}: does not fit: it was learned with another vehicle or other signals; "
        "set aside as state.json.other, learning again"
    ] == caplog.messages


@pytest.mark.parametrize(
    "snapshot",
    [
        {},
        {"estimator": 1, "monitor": 2},
        {"estimator": {}, "monitor": {"wheels": ["fl", "fr", "rl", "rr"], "alarms": [], "sets": 7}},
        {"estimator": {"order": None}, "monitor": {"wheels": ["fl", "fr", "rl", "rr"], "alarms": [None]}},
    ],
)
def test_a_snapshot_of_nonsense_is_set_aside(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, snapshot: dict[str, Any]
) -> None:
    """A whole file with a senseless snapshot never ends the daemon: one line, and a new pipeline."""
    config, database = car(tmp_path)
    state = StateKeeper(config, LOG)
    state.save(0.0, snapshot)
    pipeline = StateKeeper(config, LOG).restored(lambda: Pipeline(config, database))

    assert Pipeline(config, database).snapshot() == pipeline.snapshot()
    assert 1 == len(caplog.messages)
    assert "learning again" in caplog.messages[0]


def test_a_damaged_file_is_set_aside(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A file cut short by a power cut is set aside and reported; the daemon starts without it."""
    config, database = car(tmp_path)
    assert config.state.file is not None
    StateKeeper(config, LOG).save(0.0, Pipeline(config, database).snapshot())
    whole = config.state.file.read_text()
    config.state.file.write_text(whole[: len(whole) // 2])
    StateKeeper(config, LOG).restored(lambda: Pipeline(config, database))

    assert (tmp_path / "state.json.damaged-1").is_file()
    assert [
        f"{config.state.file}: not JSON; set aside as state.json.damaged-1, starting without it"
    ] == caplog.messages


def test_what_was_saved_is_what_is_restored(tmp_path: Path) -> None:
    """The baseline of a car that was learned once is there after a restart."""
    config, database = car(tmp_path)
    snapshot = Pipeline(config, database).snapshot()
    snapshot["monitor"]["sets"]["baseline"] |= {"ready": True, "learned_s": 700.5}
    snapshot["monitor"]["sets"]["baseline"]["reference"]["mean"][:4] = [3e-3, -3e-3, 6e-3, 0.0]
    StateKeeper(config, LOG).save(0.0, snapshot)
    restored = StateKeeper(config, LOG).restored(lambda: Pipeline(config, database))

    assert json.dumps(snapshot["monitor"]) == json.dumps(restored.snapshot()["monitor"])


def test_a_state_of_a_version_without_the_table_of_teeth_stays_valid(tmp_path: Path) -> None:
    """The digest of a car with one number of teeth is that of before the table; a table is another car."""
    config, _ = car(tmp_path)
    vehicle = asdict(config.vehicle)
    assert vehicle.pop("teeth_by_wheel") is None
    assert vehicle.pop("name") is None
    before = json.dumps({"vehicle": vehicle, "signals": config.can.signals}, sort_keys=True)
    other = replace(config, vehicle=replace(config.vehicle, teeth_by_wheel=(48.0, 48.0, 44.0, 44.0)))

    assert hashlib.sha256(before.encode()).hexdigest() == fingerprint(config)
    assert fingerprint(other) != fingerprint(config)
    named = replace(config, vehicle=replace(config.vehicle, name="the van"))
    assert fingerprint(named) == fingerprint(config)


def test_a_state_that_cannot_be_read_is_said_and_done_without(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A folder in the file's place: one warning, and a car that learns again."""
    state, config = keeper(tmp_path)
    assert config.state.file is not None
    config.state.file.mkdir()
    made = []

    def make() -> Pipeline:
        made.append(Pipeline(*car(tmp_path)))
        return made[-1]

    assert made == [state.restored(make)]
    (line,) = caplog.messages
    assert line.endswith("starting without it")


def test_without_a_file_nothing_is_kept(tmp_path: Path) -> None:
    """An empty name in the configuration switches the state off."""
    config, _ = car(tmp_path)
    state = StateKeeper(replace(config, state=replace(config.state, file=None)), LOG)
    state.save(0.0, {"n": 1})
    state.service(100.0, lambda: {"n": 2})

    assert not (tmp_path / "state.json").exists()


@pytest.mark.parametrize("digit", ["0", "f"])
def test_a_fingerprint_is_another_whichever_is_greater(
    digit: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A state of another car is no state of this one, be its digest before or behind its own."""
    config, database = car(tmp_path)
    assert config.state.file is not None
    assert "0" * 64 < fingerprint(config) < "f" * 64
    snapshot = Pipeline(config, database).snapshot()
    save_state(config.state.file, {"fingerprint": digit * 64, "pipeline": snapshot})
    StateKeeper(config, LOG).restored(lambda: Pipeline(config, database))

    assert [True] == ["with another vehicle or other signals" in message for message in caplog.messages]


@pytest.mark.parametrize(
    ("error", "reason"), [(ValueError("radii:\n  0.3"), "radii: 0.3"), (KeyError(), "KeyError")]
)
def test_the_reason_of_a_snapshot_that_does_not_fit_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, error: Exception, reason: str
) -> None:
    """On one line; an error without words is said by its type."""
    config, _ = car(tmp_path)
    StateKeeper(config, LOG).save(0.0, {"n": 1})
    StateKeeper(config, LOG).restored(lambda: HalfRestored(error))  # type: ignore[return-value, arg-type]
    assert [f": does not fit: {reason}; set aside as state.json.other, learning again"] == [
        message.removeprefix(str(config.state.file)) for message in caplog.messages
    ]


@pytest.mark.parametrize(("needs_s", "is_saved"), [(4.9, True), (5.1, False)])
def test_at_the_end_a_slow_disk_has_five_seconds(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, needs_s: float, is_saved: bool
) -> None:
    """Twice that, for a write before it too, is within the 15 s that systemd gives the daemon to stop."""

    class Slow(StateWriter):
        def finished(self, wait_s: float = 0.0) -> bool:
            return wait_s >= needs_s and super().finished(60.0)

    config, _ = car(tmp_path)
    StateKeeper(config, LOG, Slow()).save(0.0, {"n": 1})
    complaints = [] if is_saved else [f"{config.state.file}: not saved: the disk does not answer"]
    assert complaints == caplog.messages
