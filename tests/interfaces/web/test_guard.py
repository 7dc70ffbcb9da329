"""Who is let in: names, origins, tokens, and the headers of every answer."""

from __future__ import annotations

import contextlib
import socket
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from tpmsd.interfaces.cli.main import full_parser
from tpmsd.interfaces.cli.web import settings_of
from tpmsd.interfaces.web.app import live_app
from tpmsd.interfaces.web.guard import host_name
from tpmsd.interfaces.web.settings import WebSettings

TOKEN = "0123456789abcdef0123"


def client(tmp_path: Path, **settings: object) -> TestClient:
    """A browser at the page of a daemon that is not there."""
    app = live_app(tmp_path / "none.sock", WebSettings(**settings))  # type: ignore[arg-type]
    return TestClient(app, base_url="http://127.0.0.1:8377", follow_redirects=False)


@pytest.mark.parametrize(
    ("host", "code"),
    [
        ("127.0.0.1:8377", 200),
        ("localhost:1", 200),
        ("[::1]:8377", 200),
        ("evil.example", 421),
        ("127.0.0.1.evil.example", 421),
        ("", 421),
    ],
)
def test_only_own_names_are_answered(tmp_path: Path, host: str, code: int) -> None:
    """A foreign name that resolves to loopback (DNS rebinding) reaches nothing."""
    assert code == client(tmp_path).get("/", headers={"Host": host}).status_code


def test_every_answer_forbids_what_is_foreign(tmp_path: Path) -> None:
    """Pages, data and refusals alike load nothing from elsewhere, run no inline script, stand in no frame."""
    with client(tmp_path) as web:
        answers = [web.get("/"), web.get("/api/session"), web.get("/nothing"), web.get("/static/live.js")]
        answers.append(web.get("/", headers={"Host": "evil.example"}))
    for answer in answers:
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert "nosniff" == answer.headers["x-content-type-options"]


def test_pages_hold_no_inline_script_or_style() -> None:
    """What the policy forbids is not there either, and nothing is loaded from another host."""
    for page in sorted((Path(__file__).parents[3] / "tpmsd/interfaces/web/static").glob("*.html")):
        text = page.read_text(encoding="utf-8")
        assert "style=" not in text
        assert "<style" not in text
        assert "onclick" not in text
        assert "//" not in text.replace("<!--", "")
        assert text.count("<script") == text.count(" src=")


@pytest.mark.parametrize(
    ("headers", "code"),
    [
        ({}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "http://127.0.0.1:8377"}, 403),
        ({"Origin": "http://127.0.0.1:8377", "X-CSRF-Token": "guess"}, 403),
        ({"Origin": "https://127.0.0.1:8377", "X-CSRF-Token": "right"}, 403),
        ({"Origin": "http://127.0.0.1:8377", "X-CSRF-Token": "right"}, 503),
    ],
)
def test_a_reset_takes_origin_and_secret(tmp_path: Path, headers: dict[str, str], code: int) -> None:
    """Only the page's own script gets as far as the daemon (which is not there: 503)."""
    web = client(tmp_path)
    if headers.get("X-CSRF-Token") == "right":
        headers = {**headers, "X-CSRF-Token": web.get("/api/session").json()["csrf"]}
    assert code == web.post("/api/reset", content=b"{}", headers=headers).status_code


def test_a_page_of_every_local_user_asks_for_no_reset(tmp_path: Path) -> None:
    """Without a token that visitors must know, the page's own script is refused a reset, with the way out."""
    web = client(tmp_path, resets=False)
    session = web.get("/api/session").json()
    headers = {"Origin": "http://127.0.0.1:8377", "X-CSRF-Token": session["csrf"]}
    answer = web.post("/api/reset", content=b"{}", headers=headers)

    assert (False, 403) == (session["resets"], answer.status_code)
    assert "--token-file" in answer.text


@pytest.mark.parametrize(
    ("options", "mode", "allowed"),
    [([], 0o660, False), ([], 0o666, True), ([], None, False), (["--token-file", "TOKEN"], 0o660, True)],
)
def test_a_reset_over_the_page_follows_the_mode_of_the_socket(
    tmp_path: Path, options: list[str], mode: int | None, allowed: bool
) -> None:
    """Resets are open to all of the machine only where `[status] mode` opens the socket to all of it."""
    path, token = tmp_path / "s", tmp_path / "token"
    token.write_text(TOKEN, encoding="ascii")
    tmp_path.chmod(0o755)
    with contextlib.ExitStack() as stack:
        if mode is not None:
            listener = stack.enter_context(socket.socket(socket.AF_UNIX))
            listener.bind(str(path))
            path.chmod(mode)
        words = ["web", "--socket", str(path), *(str(token) if word == "TOKEN" else word for word in options)]
        assert allowed is settings_of(full_parser().parse_args(words)).resets


@pytest.mark.parametrize("body", [b"[" * 4000, b"nonsense", b'{"tyres": 7}', b"\xff"])
def test_a_reset_that_is_no_request(tmp_path: Path, body: bytes) -> None:
    """Bad bodies are 400, large ones 413."""
    web = client(tmp_path)
    headers = {"Origin": "http://127.0.0.1:8377", "X-CSRF-Token": web.get("/api/session").json()["csrf"]}
    assert 400 == web.post("/api/reset", content=body, headers=headers).status_code
    assert 413 == web.post("/api/reset", content=b"x" * 5000, headers=headers).status_code


def test_where_there_is_a_token_nothing_is_shown_without(tmp_path: Path) -> None:
    """No page and no data; the token opens as a header or, after logging in, as a cookie."""
    web = client(tmp_path, token=TOKEN)
    assert 401 == web.get("/api/session").status_code
    assert 401 == web.get("/static/live.js").status_code
    assert 401 == web.get("/api/session", headers={"Authorization": "Bearer wrong"}).status_code
    page = web.get("/", headers={"Accept": "text/html"})
    assert (303, "/login") == (page.status_code, page.headers["location"])
    assert 200 == web.get("/api/session", headers={"Authorization": f"Bearer {TOKEN}"}).status_code

    origin = {"Origin": "http://127.0.0.1:8377"}
    assert 403 == web.post("/login", content="wrong", headers=origin).status_code
    welcome = web.post("/login", content=TOKEN, headers=origin)
    assert 200 == welcome.status_code
    assert "HttpOnly" in welcome.headers["set-cookie"]
    assert "SameSite=strict" in welcome.headers["set-cookie"]
    assert 200 == web.get("/api/session").status_code


@pytest.mark.parametrize(
    ("header", "name"),
    [("a.b:80", "a.b"), ("A.B", "a.b"), ("[::1]:80", "[::1]"), ("[::1]", "[::1]"), ("", ""), (":80", "")],
)
def test_the_name_in_a_host_header(header: str, name: str) -> None:
    """Port and case do not count."""
    assert name == host_name(header)


@pytest.mark.parametrize("upgrade", ["websocket", "WebSocket", "h2c, websocket"])
def test_no_other_protocol_is_spoken(tmp_path: Path, upgrade: str) -> None:
    """A request for a WebSocket is refused in one line."""
    headers = {"Connection": "Upgrade", "Upgrade": upgrade, "Sec-WebSocket-Version": "13"}
    answer = client(tmp_path).get("/", headers=headers)
    assert (400, True) == (answer.status_code, "upgrade" in answer.text)
