"""`tpmsd bridge`: its options and what it refuses."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from tests.interfaces.bridges.documents import served
from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.bridges.secrets import read_secret
from tpmsd.interfaces.bridges.status_stream import follow_status
from tpmsd.interfaces.cli.bridge import CREDENTIAL
from tpmsd.interfaces.cli.main import main


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--broker", "h", "--node", "a/b"], "--node 'a/b'"),
        (["--broker", "h", "--base", "a+#"], "--base 'a+#'"),
        (["--broker", "h:0"], "--broker 'h:0': HOST or HOST:PORT"),
        (["--broker", "h", "--period", "0"], "--period 0"),
        (["--broker", "h", "--cert", "x"], "--cert and --key go together"),
        (["--broker", "h", "--ca", "/nowhere.pem"], "/nowhere.pem: No such file"),
        (["--broker", "h", "--password-file", "/nowhere"], "/nowhere: cannot be read"),
    ],
)
def test_wrong_options_are_refused(
    options: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line that names the option, exit code 2."""
    assert 2 == main(["bridge", "mqtt", *options])
    assert reason in capsys.readouterr().err


@pytest.mark.parametrize(
    ("bus", "reason"),
    [
        ("session", "DBUS_SESSION_BUS_ADDRESS is not set"),
        ("tcp:host=x,port=1", "--bus 'tcp:host=x,port=1'"),
        ("nothing", "--bus 'nothing': system, session"),
    ],
)
def test_a_bus_that_is_none(
    bus: str, reason: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A message bus that cannot be named is one line, exit code 2."""
    monkeypatch.delenv("DBUS_SESSION_BUS_ADDRESS", raising=False)
    assert 2 == main(["bridge", "dbus", "--bus", bus])
    assert reason in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ([], "--databroker HOST is needed"),
        (["--databroker", "h:x"], "--databroker 'h:x': HOST or HOST:PORT"),
        (["--databroker", "h", "--period", "0"], "--period 0"),
        (["--databroker", "h", "--ca", "/nowhere.pem"], "/nowhere.pem: No such file"),
        (["--databroker", "far.example", "--token-file", __file__], "longer than 4096 bytes"),
    ],
)
def test_wrong_options_of_a_databroker_are_refused(
    options: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line that names the option, exit code 2."""
    assert 2 == main(["bridge", "vss", *options])
    assert reason in capsys.readouterr().err


def test_a_token_is_not_sent_in_the_clear(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A token to another machine needs TLS."""
    (tmp_path / "token").write_text("s3cret\n", "utf-8")
    options = ["--databroker", "far.example", "--token-file", str(tmp_path / "token")]

    assert 2 == main(["bridge", "vss", *options])
    assert "a token to far.example without TLS" in capsys.readouterr().err


def test_a_password_is_not_sent_in_the_clear(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A password to another machine needs TLS; and no option takes one from the command line."""
    (tmp_path / "pw").write_text("s3cret\n", "utf-8")
    options = ["--broker", "far.example", "--user", "u", "--password-file", str(tmp_path / "pw")]

    assert 2 == main(["bridge", "mqtt", *options])
    assert "a password to far.example without TLS" in capsys.readouterr().err
    assert 2 == main(["bridge", "mqtt", "--broker", "h", "--password", "x"])


def test_secrets_come_from_files_and_credentials(tmp_path: Path) -> None:
    """A file before the systemd credential; one line, no more."""
    (tmp_path / "file").write_text("one\r\n", "utf-8")
    (tmp_path / CREDENTIAL).write_text("two", "utf-8")
    environment = {"CREDENTIALS_DIRECTORY": str(tmp_path)}

    assert "one" == read_secret(tmp_path / "file", CREDENTIAL, environment)
    assert "two" == read_secret(None, CREDENTIAL, environment)
    assert read_secret(None, CREDENTIAL, {}) is None
    for content, reason in (
        (b"", "empty"),
        (b"a\nb\n", "more than one line"),
        (b"\xff", "UTF-8"),
        (b"x" * 5000, "longer"),
    ):
        (tmp_path / "bad").write_bytes(content)
        with pytest.raises(ConfigError, match=reason):
            read_secret(tmp_path / "bad", CREDENTIAL, {})


def test_a_bridge_outlives_its_daemon(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Documents go on after the daemon was away; the log says once that it is away."""
    caplog.set_level(logging.INFO)
    got = follow_status(tmp_path / "s", logging.getLogger("tests"), sleep=lambda _: None)
    assert next(got) is None
    for _ in range(2):
        with served(tmp_path / "s", 0.02):
            assert [9, 9] == [int(float(str((next(got) or {})["tpmsd"]))) for _ in range(2)]
        while next(got) is not None:
            pass

    assert 2 == caplog.messages.count("the daemon answers again")


def test_each_try_without_a_daemon_gives_the_bridge_a_turn(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Every try that meets no daemon yields None within a second, so the bridge can answer; one log line."""
    waits_s: list[float] = []

    def sleep(duration_s: float) -> None:
        waits_s.append(duration_s)
        assert len(waits_s) < 12, "the bridge has had no turn"

    got = follow_status(tmp_path / "s", logging.getLogger("tests"), sleep=sleep)

    assert [None] * 12 == [next(got) for _ in range(12)]
    assert 11 == len(waits_s)
    assert max(waits_s) <= 1.0
    assert 1 == len(caplog.messages)
