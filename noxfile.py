"""The wheel and the sdist as built, in clean environments: `nox` (each Python that is there), `nox -s
lint`, `nox -s docs`.

In: the sources. Out: the exit code. No session uses the working tree as a package: what is tested is what
is shipped.
"""

from __future__ import annotations

import nox

nox.options.sessions = ["wheel", "sdist"]
nox.options.error_on_missing_interpreters = False
PYTHONS = ["3.11", "3.12", "3.13", "3.14"]
SMOKE = """
import sys, tempfile, pathlib
from tpmsd.interfaces.cli.main import main
drive = str(pathlib.Path(tempfile.mkdtemp()) / "drive")
assert 0 == main(["simulate", drive, "--duration", "60", "--puncture", "rl", "--at", "30"])
assert 0 == main(["check", drive]) and 0 == main(["replay", drive, "--json", drive + ".json"])
"""


def _built(session: nox.Session, kind: str) -> str:
    session.install("build")
    out = session.create_tmp()
    session.run("python", "-m", "build", f"--{kind}", "--outdir", out, ".", silent=True)
    suffix = {"wheel": ".whl", "sdist": ".tar.gz"}[kind]
    import pathlib

    (found,) = pathlib.Path(out).glob(f"*{suffix}")
    return str(found)


@nox.session(python=PYTHONS)
@nox.parametrize("numpy", ["numpy>=1.26,<2", "numpy>=2"])
def wheel(session: nox.Session, numpy: str) -> None:
    """The wheel in a clean environment, with either numpy; a drive is made, checked and replayed."""
    if numpy.endswith("<2") and session.python in ("3.13", "3.14"):
        session.skip("numpy 1.26 has no wheels for this Python")
    session.install(_built(session, "wheel"), numpy)
    session.cd(session.create_tmp())
    session.run("python", "-c", SMOKE)


@nox.session(python=PYTHONS[0])
def sdist(session: nox.Session) -> None:
    """The source distribution in a clean environment."""
    session.install(_built(session, "sdist"))
    session.cd(session.create_tmp())
    session.run("python", "-c", SMOKE)


@nox.session
def lint(session: nox.Session) -> None:
    """Style and types."""
    session.install("-e", ".[dev]")
    session.run("ruff", "check", ".")
    session.run("mypy")


@nox.session
def docs(session: nox.Session) -> None:
    """The site, with every link checked."""
    session.install("-e", ".[docs]")
    session.run("mkdocs", "build", "--strict")
