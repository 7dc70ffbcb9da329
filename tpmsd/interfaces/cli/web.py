"""`tpmsd web [DRIVE]`: a page for the running daemon, or for a recorded drive.

In: the daemon's status socket, or a drive folder. Out: an HTTP server, on loopback unless a certificate and a
token are given. It is a process of its own: the daemon serves it like any other reader of its status.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import stat
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.foundation.startup import no_collection
from tpmsd.foundation.text_file import read_text
from tpmsd.interfaces.cli.daemon_socket import add_socket_options, daemon_socket
from tpmsd.interfaces.cli.filter_options import add_filter_options, refuse_without_drive, with_filter
from tpmsd.interfaces.cli.output import Progress, Subparsers
from tpmsd.offline.tables.extras import import_extra

if TYPE_CHECKING:
    from starlette.applications import Starlette

    from tpmsd.interfaces.web.settings import WebSettings

_LONGEST_TOKEN, _SHORTEST_TOKEN = 200, 16
_EPILOG = """\
examples:
  tpmsd web                                 the daemon of this machine, on http://127.0.0.1:8377/
  tpmsd web --config vehicle.toml           the daemon with this configuration
  tpmsd web drives/monday                   a recorded drive: map, radii, alarms
  tpmsd web --host car.lan --certificate c.pem --key k.pem --token-file token
                                            for others, too; they are asked for the token
"""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "web",
        help="a page for the running daemon or a recorded drive",
        description="Serve a page that shows the tyres as the running daemon sees them, or a recorded drive.",
        epilog=_EPILOG,
    )
    parser.add_argument("drive", metavar="DRIVE", nargs="?", type=Path, help="a drive folder to look into")
    add_socket_options(parser)
    add_filter_options(parser.add_argument_group("the filter of a recorded drive"))
    server = parser.add_argument_group("the server")
    server.add_argument("--host", metavar="NAME", default="127.0.0.1", help="address (default: 127.0.0.1)")
    server.add_argument("--port", metavar="N", type=int, default=8377, help="default: 8377; 0: any free one")
    server.add_argument("--certificate", metavar="FILE", type=Path, help="TLS certificate (PEM)")
    server.add_argument("--key", metavar="FILE", type=Path, help="its private key (PEM)")
    server.add_argument(
        "--token-file", metavar="FILE", type=Path, help="file with the token that visitors must know"
    )


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    import_extra("uvicorn", "web", "pages")
    settings = settings_of(args)
    with no_collection():  # nearly all that an import makes stays
        from tpmsd.interfaces.web.server import make_server, port_of
    app = _make_app(args, settings)

    try:
        server, listener = make_server(app, settings, args.certificate, args.key)
    except (OSError, SystemExit) as error:
        reason = error.strerror if isinstance(error, OSError) else None
        raise TpmsdError(
            f"{settings.host}:{settings.port}: cannot listen{f': {reason}' if reason else ''}"
        ) from None
    scheme = "https" if settings.secure else "http"
    print(f"{scheme}://{settings.host}:{port_of(listener)}/  (Ctrl-C ends it)", file=sys.stderr, flush=True)
    if settings.token is None:
        may = "look and ask for a reset" if settings.resets else "look"
        resets = "" if settings.resets or args.drive is not None else " and allows resets"
        print(
            f"tpmsd: whoever is on this machine may {may}; --token-file asks them for a token{resets}",
            file=sys.stderr,
        )
    os.nice(settings.niceness)
    server.run(sockets=[listener])
    return 0


def settings_of(args: argparse.Namespace) -> WebSettings:
    """Return host, port and secrets; ConfigError where the page would be open to others without a token."""
    from tpmsd.interfaces.web.guard import LOOPBACK
    from tpmsd.interfaces.web.settings import WebSettings

    if not 0 <= args.port <= 65535:
        raise ConfigError(f"--port {args.port}: 0 to 65535")
    if (args.certificate is None) != (args.key is None):
        raise ConfigError("--certificate and --key go together")
    for file in (args.certificate, args.key):
        if file is not None and not file.is_file():
            raise ConfigError(f"{file}: no such file")
    token = None if args.token_file is None else _read_token(args.token_file)
    if args.host not in LOOPBACK and (token is None or args.certificate is None):
        raise ConfigError(
            f"--host {args.host}: others could look on; that takes --certificate, --key and --token-file"
        )
    resets = token is not None or (args.drive is None and _writable_for_all(daemon_socket(args)))
    return WebSettings(
        host=args.host, port=args.port, token=token, resets=resets, secure=args.certificate is not None
    )


def _writable_for_all(path: Path) -> bool:
    """Return True where every local user may connect to the socket, and ask for a reset without the page."""
    try:
        reachable = path.parent.stat().st_mode & stat.S_IXOTH
        return bool(reachable and path.stat().st_mode & stat.S_IWOTH)
    except OSError:
        return False


def _read_token(file: Path) -> str:
    token = read_text(file, _LONGEST_TOKEN + 2, "a token").strip()
    if not _SHORTEST_TOKEN <= len(token) <= _LONGEST_TOKEN or not token.isascii() or not token.isprintable():
        raise ConfigError(f"{file}: a token has {_SHORTEST_TOKEN} to {_LONGEST_TOKEN} ASCII characters")
    return token


def _make_app(args: argparse.Namespace, settings: WebSettings) -> Starlette:
    with no_collection():
        from tpmsd.interfaces.web.app import drive_app, live_app

    if args.drive is None:
        refuse_without_drive(args)
        return live_app(daemon_socket(args), settings)
    with no_collection():
        from tpmsd.interfaces.api.functions import replay
        from tpmsd.interfaces.cli.drive_reading import span_s
        from tpmsd.offline.drives.drive import load

    drive = load(args.drive)
    drive = dataclasses.replace(drive, config=with_filter(drive.config, args))
    with Progress(span_s(args.drive) if sys.stderr.isatty() else 0.0, "replay") as bar:
        replayed = replay(drive, model=args.model, progress=bar.update)
    for note in replayed.notes:
        print(f"tpmsd: {note}", file=sys.stderr)
    return drive_app(replayed, settings, args.model)
