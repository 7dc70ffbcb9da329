"""`make install` into a folder and away again, and the Debian package as it lies on the disk."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import REPO

PREFIX = "/opt/tpmsd"
BELONGS = {
    "/usr/local/bin/tpmsd",
    "/usr/local/lib/systemd/system/tpmsd.service",
    "/usr/local/lib/systemd/system/tpmsd@.service",
    "/usr/local/share/man/man1/tpmsd.1",
    "/usr/local/share/doc/tpmsd/how-to/running.md",
    "/usr/local/share/doc/tpmsd/tpmsd.dbc",
    "/usr/local/share/doc/tpmsd/examples/network/80-can0.network",
    "/usr/local/share/doc/tpmsd/examples/udev/70-tpmsd-gnss.rules",
    f"{PREFIX}/bin/tpmsd",
}


def make(target: str, destination: Path) -> str:
    environment = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "MAKELEVEL")}
    done = subprocess.run(
        ["make", target, f"DESTDIR={destination}"], cwd=REPO, capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("install") / "root"
    make("install", folder)
    yield folder
    shutil.rmtree(folder.parent)


def test_everything_is_in_its_place(root: Path) -> None:
    """Program, units, page and examples; the configuration's folder is there and empty."""
    assert [] == [path for path in sorted(BELONGS) if not os.path.lexists(f"{root}{path}")]
    assert [] == list((root / "etc" / "tpmsd").iterdir())
    assert f"{PREFIX}/bin/tpmsd" == str((root / "usr/local/bin/tpmsd").readlink())


def test_nothing_names_the_folder_it_was_built_in(root: Path) -> None:
    """Neither the stage nor the sources are written anywhere: scripts, settings, compiled modules, units."""
    for name in (str(root), str(REPO)):
        found = subprocess.run(["grep", "-rlaF", name, str(root)], capture_output=True, text=True)
        assert "" == found.stdout


def test_no_list_of_files_has_a_hash_that_the_build_folder_decides(root: Path) -> None:
    """Commands and the place of the sources name that folder: two builds of one commit would differ."""
    lists = sorted(root.glob(f".{PREFIX}/lib/python3*/site-packages/*.dist-info/RECORD"))
    listed = [line for path in lists for line in path.read_text(encoding="utf-8").splitlines()]

    assert lists
    assert [] == [line for line in listed if line.startswith("../../../bin/") or "/direct_url.json," in line]


def test_the_units_start_what_was_installed(root: Path) -> None:
    """ExecStart is the program that lies there."""
    units = root / "usr/local/lib/systemd/system"
    for unit in ("tpmsd.service", "tpmsd@.service"):
        (program,) = re.findall(r"^ExecStart=(\S+)", (units / unit).read_text(), re.M)
        assert os.access(f"{root}{program}", os.X_OK), program


def test_the_installed_program_runs(root: Path) -> None:
    """With the modules that were installed beside it, and no others."""
    (modules,) = root.glob("opt/tpmsd/lib/python3.*/site-packages")
    program = "import tpmsd, tpmsd.onboard.daemon.loop, sys; print(tpmsd.__file__)"
    done = subprocess.run(
        [root / "opt/tpmsd/bin/python", "-I", "-c", program], capture_output=True, text=True
    )

    assert (f"{modules}/tpmsd/__init__.py", "") == (done.stdout.strip(), done.stderr)


def test_uninstall_leaves_nothing_but_what_is_the_owners(root: Path) -> None:
    """Every file goes, except configuration."""
    (root / "etc/tpmsd/tpmsd.toml").write_text("kept = true\n")
    make("uninstall", root)

    assert ["etc/tpmsd/tpmsd.toml"] == [
        str(path.relative_to(root)) for path in root.rglob("*") if path.is_file() or path.is_symlink()
    ]


def contents(deb: str) -> dict[str, str]:
    """Path and mode of everything in the package, by `dpkg -c`."""
    listing = subprocess.run(["dpkg", "-c", deb], capture_output=True, text=True, check=True).stdout
    rows = [line.split(maxsplit=5) for line in listing.splitlines()]
    return {row[5].split(" -> ")[0].removeprefix("."): f"{row[0]} {row[1]}" for row in rows}


def test_the_package_holds_what_belongs_there() -> None:
    """Program, units, page, examples: owned by root, writable by nobody else, nothing compiled or private."""
    files = contents(os.environ["TPMSD_DEB"])
    wanted = {
        path.replace("/usr/local/lib/systemd", "/lib/systemd").replace("/usr/local", "/usr")
        for path in BELONGS
    }
    wanted = {path.replace(PREFIX, "/usr/lib/tpmsd") for path in wanted}

    assert set() == {path for path in wanted if path not in files and f"{path}.gz" not in files}
    assert {"root/root"} == {row.split()[1] for row in files.values()}
    assert [] == [path for path, row in files.items() if row[0] != "l" and ("w" in row[5] or "w" in row[8])]
    assert [] == [path for path in files if "__pycache__" in path or "/home/" in path or str(REPO) in path]
    assert [] == [path for path in files if path.startswith("/etc/") and not path.endswith("/")]


def test_the_package_says_what_it_needs() -> None:
    """The very Python for which its modules were compiled, and a C library."""
    deb = os.environ["TPMSD_DEB"]
    field = subprocess.run(["dpkg", "-f", deb, "Depends"], capture_output=True, text=True, check=True).stdout
    (version,) = {
        match[1]
        for path in contents(deb)
        if (match := re.match(r"/usr/lib/tpmsd/lib/python(3\.\d+)/$", path))
    }

    assert f"python3 (>= {version}~)" in field
    assert "libc6" in field


def test_lintian_finds_no_error() -> None:
    """No error and no warning, but that the address of a maintainer is for the one who builds to set."""
    lintian = shutil.which("lintian")
    if lintian is None:
        pytest.fail("no lintian here (Debian: apt-get install lintian)")
    done = subprocess.run(
        [lintian, "--fail-on", "none", os.environ["TPMSD_DEB"]], capture_output=True, text=True, timeout=1800
    )
    found = [line for line in done.stdout.splitlines() if line[:2] in ("E:", "W:")]

    assert [] == [line for line in found if "bogus-mail-host" not in line]
