"""Requests for a reset: as frames, as sentences, and by the command over a real socket."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.beside import beside
from tpmsd.interfaces.cli.main import main
from tpmsd.onboard.sinks.reset_request import ResetRequest, from_frame, from_sentence, to_frame, to_sentence
from tpmsd.onboard.sinks.status_client import StatusError, request_reset
from tpmsd.onboard.sinks.status_server import StatusServer

NAMES = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,23}", fullmatch=True)


@settings(derandomize=True, deadline=None)
@given(st.one_of(st.none(), NAMES))
def test_a_sentence_there_and_back(name: str | None) -> None:
    """What is written is read again, with its line end too."""
    line = to_sentence(ResetRequest(name))
    assert ResetRequest(name) == from_sentence(line) == from_sentence(line + b"\r\n")


def test_the_sentence_by_hand() -> None:
    """NMEA's checksum: exclusive or of all between $ and *."""
    total = 0
    for byte in b"PTPMSD,RESET,winter":
        total ^= byte
    assert b"$PTPMSD,RESET,winter*%02X" % total == to_sentence(ResetRequest("winter"))


@settings(derandomize=True, deadline=None)
@given(st.binary(max_size=64))
def test_noise_is_no_request(data: bytes) -> None:
    """Whatever comes, nothing is raised; and it is a request only if writing that gives it back."""
    sentence, frame = from_sentence(data), from_frame(data)
    assert sentence is None or to_sentence(sentence) == data.strip()
    numbers = [k for k in range(8) if to_frame(k) == data[:3]]
    assert [frame] == [ResetRequest(f"set{k}" if k else None) for k in numbers] or frame is None


def test_a_frame_there_and_back() -> None:
    """The number of a set is its name; a wrong checksum, code or number is no request."""
    assert ResetRequest(None) == from_frame(to_frame())
    assert ResetRequest("set3") == from_frame(to_frame(3) + b"\0" * 5)
    assert [None] * 4 == [from_frame(data) for data in (b"", b"\0R\0", to_frame(8), to_frame(1)[:2])]


@contextmanager
def daemon(path: Path, reset: str, reason: str, why_not: str = "") -> Iterator[list[str | None]]:
    """A status server whose next tick takes the reset up as told."""
    asked: list[str | None] = []
    baseline: dict[str, Any] = {"resets": 4, "reset": "none", "reset_reason": ""}

    def take(tyres: str | None) -> str:
        asked.append(tyres)
        return why_not

    server = StatusServer(path, lambda: {"version": 1, "baseline": dict(baseline)}, reset=take)
    server.open()

    def loop(over: threading.Event) -> None:
        while not over.wait(0.02):
            server.service(time.monotonic())
            if asked and not server.clients:
                baseline.update(resets=5, reset=reset, reset_reason=reason)
        server.close()

    with beside(loop):
        yield asked


@pytest.mark.parametrize(
    ("reset", "code"),
    [("accepted", 0), ("learning", 0), ("refused", 1)],
    ids=["accepted", "learning", "refused"],
)
def test_the_command_says_what_became_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], reset: str, code: int
) -> None:
    """It waits for the tick that takes the request, prints the daemon's reason, and its exit code is 1 if
    refused."""
    path = tmp_path / "s.sock"
    with daemon(path, reset, "why or why not") as asked:
        assert code == main(["reset", "--tyres", "winter", "--socket", str(path)])
    assert ["winter"] == asked
    assert "why or why not\n" == capsys.readouterr().out


def test_json_for_programs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--json -` writes the baseline's part of the status, and nothing else."""
    path = tmp_path / "s.sock"
    with daemon(path, "accepted", "learning default again"):
        assert 0 == main(["reset", "--json", "-", "--socket", str(path)])
    out = capsys.readouterr().out
    assert '"reset": "accepted"' in out
    assert out.startswith("{")


def test_a_name_that_the_daemon_refuses_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The daemon's answer is the command's one line."""
    path = tmp_path / "s.sock"
    with daemon(path, "", "", "that is no name of a set of tyres"):
        assert 1 == main(["reset", "--tyres", "Ünder", "--socket", str(path)])
    error = capsys.readouterr().err
    assert "that is no name of a set of tyres" in error
    assert 1 == error.count("\n")


def test_without_a_daemon_it_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nobody on the socket: one line, exit code 1."""
    assert 1 == main(["reset", "--socket", str(tmp_path / "none.sock")])
    assert "is tpmsd running?" in capsys.readouterr().err


def test_a_server_without_resets_says_so(tmp_path: Path) -> None:
    """Where nobody takes resets the request is answered, not ignored."""
    path = tmp_path / "s.sock"
    server = StatusServer(path, lambda: {"version": 1})
    server.open()

    def serve() -> None:
        for _ in range(50):
            time.sleep(0.02)
            server.service(0.0)

    thread = threading.Thread(target=serve)
    thread.start()
    with pytest.raises(StatusError, match="takes no resets"):
        request_reset(path, None)
    thread.join()
    server.close()
