"""The state file under power cuts, full disks and damage of every kind."""

from __future__ import annotations

import errno
import itertools
import json
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.sinks.state_file import (
    KEPT_DAMAGED,
    MAX_BYTES,
    FileSystem,
    StateDamaged,
    StateError,
    encode_state,
    load_state,
    save_state,
)

OLD = {"baseline_m": [-0.0012, 0.0003], "drive": 1}
NEW = {"baseline_m": [-0.0013, 0.0004], "drive": 2, "note": "Grüße"}


def load(path: Path) -> tuple[dict[str, Any] | None, list[StateDamaged]]:
    reports: list[StateDamaged] = []
    return load_state(path, on_damaged=reports.append), reports


# ---- what goes in comes out


def test_what_was_saved_is_loaded(tmp_path: Path) -> None:
    """A payload comes back equal, and the folder holds nothing but the state."""
    path = tmp_path / "lib" / "state.json"
    save_state(path, OLD)
    save_state(path, NEW)
    assert (NEW, []) == load(path)
    assert [path] == list(path.parent.iterdir())
    assert 0o640 & ~_umask() == path.stat().st_mode & 0o777


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_no_state_yet_is_no_fault(tmp_path: Path) -> None:
    """A missing file gives None and no report."""
    assert (None, []) == load(tmp_path / "state.json")


json_values: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)


@given(st.dictionaries(st.text(), json_values, max_size=5))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_any_payload_survives(tmp_path_factory: pytest.TempPathFactory, payload: dict[str, Any]) -> None:
    """Any JSON object comes back equal, whatever its keys, texts and numbers."""
    path = tmp_path_factory.mktemp("state") / "state.json"
    save_state(path, payload)
    assert (payload, []) == load(path)


def test_numbers_that_are_not_finite_and_keys_that_are_no_text_survive(tmp_path: Path) -> None:
    """NaN and infinity come back; integer keys come back as text, under a checksum that holds."""
    path = tmp_path / "state.json"
    save_state(path, {10: math.inf, 9: math.nan})  # type: ignore[dict-item]
    payload, reports = load(path)
    assert [] == reports
    assert payload is not None
    assert ({"9", "10"}, math.inf, True) == (set(payload), payload["10"], math.isnan(payload["9"]))


# ---- power cuts


class PowerCut(BaseException):
    """The lights go out: not even an error handler runs on the disk that is left."""


@dataclass
class _Inode:
    cached: bytes = b""
    synced: bytes = b""


@dataclass
class VolatileDisk:
    """A folder on a disk that may forget all that was not synced, and the power that fails at one call.

    Contents written but not synced may be kept, lost or cut in the middle; directory entries changed but not
    synced may be kept up to any one of the changes.
    """

    cut_at: int
    inodes: list[_Inode] = field(default_factory=list)
    entries: dict[str, int] = field(default_factory=dict)
    histories: list[dict[str, int]] = field(default_factory=list)
    """States of the directory since it was last synced, the synced one first."""
    calls: int = 0
    _open: dict[int, int | None] = field(default_factory=dict)

    def start_with(self, name: str, content: bytes) -> None:
        self.inodes.append(_Inode(content, content))
        self.entries = {name: len(self.inodes) - 1}
        self.histories = [dict(self.entries)]

    def system(self) -> FileSystem:
        return FileSystem(self.open, self.write, self.fsync, self.close, self.replace, self.unlink)

    def _call(self) -> None:
        if self.calls == self.cut_at:
            raise PowerCut
        self.calls += 1

    def open(self, name: str, flags: int, mode: int) -> int:
        self._call()
        descriptor = 100 + self.calls
        if flags & os.O_DIRECTORY:
            self._open[descriptor] = None
            return descriptor
        if name in self.entries and flags & os.O_EXCL:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        if name not in self.entries:
            self.inodes.append(_Inode())
            self.entries[name] = len(self.inodes) - 1
            self.histories.append(dict(self.entries))
        if flags & os.O_TRUNC:
            self.inodes[self.entries[name]].cached = b""
        self._open[descriptor] = self.entries[name]
        return descriptor

    def write(self, descriptor: int, data: bytes) -> int:
        self._call()
        inode = self._open[descriptor]
        assert inode is not None
        part = data[:40]  # short writes are allowed, so be short
        self.inodes[inode].cached += part
        return len(part)

    def fsync(self, descriptor: int) -> None:
        self._call()
        inode = self._open[descriptor]
        if inode is None:
            self.histories = [dict(self.entries)]
        else:
            self.inodes[inode].synced = self.inodes[inode].cached

    def close(self, descriptor: int) -> None:
        self._call()
        del self._open[descriptor]

    def replace(self, source: str, target: str) -> None:
        self._call()
        self.entries[target] = self.entries.pop(source)
        self.histories.append(dict(self.entries))

    def unlink(self, name: str) -> None:
        self._call()
        if name not in self.entries:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        del self.entries[name]
        self.histories.append(dict(self.entries))

    def survivors(self, name: str) -> Iterator[bytes | None]:
        """Everything that file `name` may hold once the power is back."""
        for entries in self.histories:
            if name not in entries:
                yield None
                continue
            inode = self.inodes[entries[name]]
            yield inode.synced
            if inode.cached != inode.synced:
                yield from (inode.cached, inode.cached[: len(inode.cached) // 2], b"")


def test_after_a_power_cut_at_any_step_the_state_is_old_or_new(tmp_path: Path) -> None:
    """Whatever the disk forgets, the file holds the old or the new payload; the new one if save returned."""
    path = tmp_path / "state.json"
    save_state(path, OLD)
    old_content = path.read_bytes()
    for cut_at in itertools.count():
        disk = VolatileDisk(cut_at)
        disk.start_with(str(path), old_content)
        try:
            save_state(path, NEW, files=disk.system())
        except PowerCut:
            finished = False
        else:
            finished = True
        outcomes = []
        for content in disk.survivors(str(path)):
            assert content is not None
            path.write_bytes(content)
            outcomes.append(load(path))
        assert all(outcome in [(OLD, []), (NEW, [])] for outcome in outcomes)
        if finished:
            assert [(NEW, [])] == outcomes
            break
    assert cut_at > 8


@dataclass
class FailingCalls:
    """The real file system, of which one call fails with one error."""

    fail_at: int
    error: int
    calls: int = 0

    def system(self) -> FileSystem:
        real = FileSystem()
        return FileSystem(
            open=self._wrap(real.open),
            write=self._wrap(real.write),
            fsync=self._wrap(real.fsync),
            close=self._wrap(real.close),
            replace=self._wrap(real.replace),
        )

    def _wrap(self, call: Any) -> Any:
        def wrapper(*args: Any) -> Any:
            self.calls += 1
            if self.calls - 1 == self.fail_at:
                raise OSError(self.error, os.strerror(self.error))
            return call(*args)

        return wrapper


@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EROFS, errno.EIO, errno.EACCES])
def test_a_step_that_fails_leaves_a_whole_state_and_says_why(tmp_path: Path, error: int) -> None:
    """Disk full, read-only or broken at any step: one line, nothing left over, and a later save works."""
    path = tmp_path / "state.json"
    for fail_at in itertools.count():
        save_state(path, OLD)
        failing = FailingCalls(fail_at, error)
        try:
            save_state(path, NEW, files=failing.system())
        except StateError as caught:
            assert f"{path}: cannot save the state: {os.strerror(error)}" == str(caught)
            assert 1 == caught.exit_code
            payload, reports = load(path)
            assert payload in (OLD, NEW)
            assert [] == reports
            assert [path] == list(tmp_path.iterdir())
        else:
            break
    assert fail_at > 5


def test_a_link_that_appears_in_the_last_moment_is_not_followed(tmp_path: Path) -> None:
    """A link put under the temporary name after that was cleared: refused, and its target is untouched."""
    path, other = tmp_path / "state.json", tmp_path / "other"
    other.write_text("not ours", encoding="utf-8")

    def unlink(name: str) -> None:
        Path(name).unlink(missing_ok=True)
        Path(name).symlink_to(other)

    with pytest.raises(StateError, match="File exists"):
        save_state(path, NEW, files=FileSystem(unlink=unlink))
    assert ("not ours", False) == (other.read_text("utf-8"), path.exists())


@pytest.mark.parametrize("kind", ["fifo", "link", "file"])
def test_what_stands_under_the_temporary_name_is_neither_waited_for_nor_followed(
    tmp_path: Path, kind: str
) -> None:
    """A FIFO, a link to another file or a leftover under the temporary name: saved at once, nothing else is
    written."""
    path, other = tmp_path / "lib" / "state.json", tmp_path / "other"
    path.parent.mkdir()
    temporary = path.with_name(".state.json.new")
    other.write_text("mine")
    if kind == "fifo":
        os.mkfifo(temporary)
    elif kind == "link":
        temporary.symlink_to(other)
    else:
        temporary.write_text("left over")
    save_state(path, NEW)
    assert (NEW, []) == load(path)
    assert "mine" == other.read_text()
    assert [path] == list(path.parent.iterdir())


def test_a_folder_under_the_temporary_name_is_one_line(tmp_path: Path) -> None:
    """What cannot be taken away is an error that says so; the old state stands."""
    path = tmp_path / "state.json"
    save_state(path, OLD)
    path.with_name(".state.json.new").mkdir()
    with pytest.raises(StateError, match="cannot save the state"):
        save_state(path, NEW)
    assert (OLD, []) == load(path)


def test_a_folder_that_may_not_be_written_is_an_error_of_one_line(tmp_path: Path) -> None:
    """A parent that is a file gives StateError, not a traceback."""
    (tmp_path / "lib").write_text("a file")
    with pytest.raises(StateError) as caught:
        save_state(tmp_path / "lib" / "state.json", NEW)
    assert "\n" not in str(caught.value)


def test_a_payload_that_is_no_json_or_too_big_is_refused(tmp_path: Path) -> None:
    """What could not be loaded again is not saved, and the old state stands."""
    path = tmp_path / "state.json"
    save_state(path, OLD)
    for payload in ({"a": object()}, {"a": "x" * MAX_BYTES}):
        with pytest.raises(StateError):
            save_state(path, payload)
    assert (OLD, []) == load(path)


# ---- damage


def test_a_state_of_900_kb_is_kept(tmp_path: Path) -> None:
    """The bound is for what is not ours: a state far greater than any that a car makes is saved and read."""
    save_state(tmp_path / "state.json", {"a": "x" * 900_000})
    assert ({"a": "x" * 900_000}, []) == load(tmp_path / "state.json")


def test_a_file_cut_at_any_byte_is_noticed(tmp_path: Path) -> None:
    """Every proper prefix of a state file is damaged, is moved aside and reported."""
    path = tmp_path / "state.json"
    save_state(path, NEW)
    content = path.read_bytes()
    for length in range(len(content)):
        path.write_bytes(content[:length])
        payload, reports = load(path)
        assert (None, 1, False) == (payload, len(reports), path.exists())
        aside = reports[0].set_aside
        assert aside is not None
        assert content[:length] == aside.read_bytes()


@given(st.data())
@settings(derandomize=True, deadline=None, max_examples=200)
def test_a_changed_byte_is_noticed(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """A file with one byte changed loads as it was or not at all, never as something else."""
    path = tmp_path_factory.mktemp("state") / "state.json"
    save_state(path, NEW)
    content = bytearray(path.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    payload, reports = load(path)
    assert (payload, reports) == (NEW, []) or (payload is None and len(reports) == 1)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "empty"),
        (b"\x00" * 512, "not JSON"),
        (b"\xff\xfe\x80", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b'{"a": ' + b"9" * 5000 + b"}", "not JSON"),
        (b"[]", "not a state file of tpmsd"),
        (b'{"format": "other"}', "not a state file of tpmsd"),
        (b'{"format": "tpmsd-state", "version": 2, "payload": {}}', "version 2 instead of 1"),
        (b'{"format": "tpmsd-state", "version": true, "payload": {}}', "version True instead of 1"),
        (b'{"format": "tpmsd-state", "payload": {}}', "version None instead of 1"),
        (b'{"format": "tpmsd-state", "version": 1, "payload": []}', "no payload"),
        (b'{"format": "tpmsd-state", "version": 1, "payload": {}, "sha256": "00"}', "wrong checksum"),
        (b'{"format": "tpmsd-state", "version": 1, "payload": {}, "sha256": 7}', "wrong checksum"),
        (b" " * (MAX_BYTES + 1), f"more than {MAX_BYTES} bytes"),
    ],
)
def test_what_is_no_state_is_set_aside_with_its_reason(tmp_path: Path, content: bytes, reason: str) -> None:
    """One line says what is wrong and where the file went."""
    path = tmp_path / "state.json"
    path.write_bytes(content)
    payload, reports = load(path)
    assert (None, [StateDamaged(path, reason, tmp_path / "state.json.damaged-1")]) == (payload, reports)
    assert f"{path}: {reason}; set aside as state.json.damaged-1, starting without it" == str(reports[0])


def test_only_the_last_damaged_files_are_kept(tmp_path: Path) -> None:
    """After ten damaged starts the three newest are there, and foreign files are left alone."""
    path = tmp_path / "state.json"
    foreign = tmp_path / "state.json.damaged-by-hand"
    foreign.write_text("keep me")
    for i in range(10):
        path.write_text(f"broken {i}")
        load(path)
    kept = {file.name: file.read_text() for file in tmp_path.iterdir() if file != foreign}
    assert {f"state.json.damaged-{n}": f"broken {n - 1}" for n in (8, 9, 10)} == kept
    assert KEPT_DAMAGED == len(kept)
    assert foreign.exists()


def test_a_damaged_file_that_cannot_be_moved_is_still_reported(tmp_path: Path) -> None:
    """Where setting aside fails (here the new name is too long) the daemon starts all the same."""
    path = tmp_path / ("s" * 250)
    path.write_text("broken")
    assert (None, [StateDamaged(path, "not JSON", None)]) == load(path)
    assert path.exists()


def test_damage_is_logged_where_nobody_asks_for_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Without a callback the report is a warning in the log."""
    path = tmp_path / "state.json"
    path.write_text("broken")
    assert load_state(path) is None
    assert [f"{path}: not JSON; set aside as state.json.damaged-1, starting without it"] == caplog.messages


@pytest.mark.parametrize("kind", ["directory", "fifo"])
def test_what_is_no_file_is_an_error_and_does_not_hang(tmp_path: Path, kind: str) -> None:
    """A folder or a pipe under the state's name gives one clear line at once."""
    path = tmp_path / "state.json"
    if kind == "fifo":
        os.mkfifo(path)
    else:
        path.mkdir()
    with pytest.raises(StateError) as caught:
        load(path)
    assert f"{path}: cannot read the state: not a regular file" == str(caught.value)


def test_the_file_is_plain_json_with_its_version(tmp_path: Path) -> None:
    """Anybody can read the file with a JSON tool."""
    path = tmp_path / "state.json"
    save_state(path, OLD)
    record = json.loads(path.read_text())
    assert {"format": "tpmsd-state", "version": 1, "payload": OLD} == {
        key: record[key] for key in ("format", "version", "payload")
    }


def test_the_order_of_keys_says_nothing(tmp_path: Path) -> None:
    """Equal payloads make equal files, and a JSON tool that sorts or turns the keys does no damage."""
    path = tmp_path / "state.json"
    turned = dict(reversed(list(OLD.items())))
    assert encode_state(path, OLD) == encode_state(path, turned)
    record = json.loads(encode_state(path, OLD))
    path.write_text(json.dumps(dict(reversed(list(record.items()))) | {"payload": turned}))
    assert (OLD, []) == load(path)


def test_folders_that_are_missing_are_made(tmp_path: Path) -> None:
    """The state's folder may lie in one that is missing, too."""
    path = tmp_path / "var" / "lib" / "state.json"
    save_state(path, OLD)
    assert (OLD, []) == load(path)


@pytest.mark.parametrize(("more", "fits"), [(0, True), (1, False)])
def test_a_state_may_have_a_megabyte_and_no_byte_more(more: int, fits: bool, tmp_path: Path) -> None:
    """The same bound holds for what is written and for what is read."""
    path = tmp_path / "state.json"
    empty = len(encode_state(path, {"a": ""}))
    payload = {"a": "x" * ((1 << 20) - empty + more)}
    try:
        content = encode_state(path, payload)
    except StateError as error:
        assert not fits and f"{(1 << 20) + 1} bytes, at most {1 << 20} allowed" in str(error)
        content = encode_state(path, {"a": ""})[:-3] + b" " * (1 << 20)
    path.write_bytes(content)
    loaded, damaged = load(path)

    assert (payload, []) == (loaded, damaged) if fits else "more than 1048576 bytes" == damaged[0].reason
