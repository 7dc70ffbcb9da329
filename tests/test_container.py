"""The container's files as text: what they promise stands in them, and what they run exists."""

from __future__ import annotations

import re
import tomllib
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement

from tests.conftest import REPO
from tools import make_lock
from tpmsd.interfaces.cli.main import full_parser

FOLDER = REPO / "contrib" / "container"
COMPOSE: dict[str, Any] = yaml.safe_load((FOLDER / "compose.yml").read_text("utf-8"))
OURS = {name: one for name, one in COMPOSE["services"].items() if one["image"] == "tpmsd"}


def instructions() -> list[tuple[str, str]]:
    """Instruction and argument of each line of the Containerfile, continued lines joined."""
    text = (FOLDER / "Containerfile").read_text("utf-8").replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(line.split(None, 1)[0], line.split(None, 1)[1]) for line in lines]


def of(name: str) -> list[str]:
    return [argument for instruction, argument in instructions() if instruction == name]


def test_the_image_is_built_in_two_stages_of_pinned_bases() -> None:
    """The second stage takes the environment of the first and nothing else; bases have a version."""
    bases, (default,) = of("FROM"), of("ARG")
    last = max(k for k, (name, _) in enumerate(instructions()) if name == "FROM")
    copied = [argument for name, argument in instructions()[last:] if name == "COPY"]

    assert ["${BASE} AS build", "${BASE}"] == bases
    assert re.fullmatch(r"BASE=[a-z]+:\d+\.\d+-slim-[a-z]+", default)
    assert ["--from=build /opt/tpmsd /opt/tpmsd"] == copied
    assert [] == of("ADD")


def test_the_image_runs_as_nobody_special() -> None:
    """The last user is a number that is not root's, as the folders that are written to are."""
    (user,) = of("USER")
    run = " ".join(of("RUN"))

    assert re.fullmatch(r"[1-9]\d{3,}:[1-9]\d{3,}", user)
    assert f"useradd --uid {user.split(':')[0]} " in run
    for folder in ("/var/lib/tpmsd", "/run/tpmsd"):
        assert re.search(rf"-o {user.split(':')[0]} -g {user.split(':')[1]} -m 0\d+ {folder}", run)


def locked() -> dict[str, tuple[str, int]]:
    """Version and number of hashes of each package of the lock file."""
    text = (FOLDER / "requirements.txt").read_text("utf-8").replace("\\\n", " ")
    lines = [line.split() for line in text.splitlines() if line and not line.startswith("#")]
    assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", each) for line in lines for each in line[1:])
    return {line[0].split("==")[0]: (line[0].split("==")[1], len(line) - 1) for line in lines}


def test_each_package_is_installed_by_its_hash() -> None:
    """All that is fetched has a version and a hash; the program itself is installed without a network."""
    fetched, own = (part for argument in of("RUN") for part in argument.split("&&") if "pip install" in part)
    project = tomllib.loads((REPO / "pyproject.toml").read_text("utf-8"))["project"]
    wanted = [Requirement(each) for each in project["dependencies"]]
    wanted += [
        Requirement(each) for extra in make_lock.EXTRAS for each in project["optional-dependencies"][extra]
    ]

    assert "--require-hashes" in fetched and "requirements.txt" in fetched
    assert {"--no-deps", "--no-index", "--no-build-isolation"} <= set(own.split())
    for each in wanted:
        version, hashes = locked()[each.name]
        compiled = each.name in ("numpy", "scipy")
        assert version in each.specifier and hashes == (len(make_lock.PROCESSORS) if compiled else 1), each


def test_a_lock_of_two_processors_has_the_hashes_of_both() -> None:
    """A pure wheel has one hash, a compiled one has two; two versions of one package are refused."""
    one, other = (
        {"a": ("1.0", "0" * 64), "b": ("2.0", "1" * 64)},
        {"a": ("1.0", "0" * 64), "b": ("2.0", "2" * 64)},
    )
    assert ["a==1.0", "b==2.0"] == [w for w in make_lock.lock([one, other]).split() if "==" in w]
    assert 3 == make_lock.lock([one, other]).count("--hash=sha256:")
    with pytest.raises(ValueError, match=r"b: 2\.0 and 2\.1"):
        make_lock.lock([one, {"b": ("2.1", "2" * 64)}])


def test_what_is_installed_and_run_exists() -> None:
    """Copied files are here, and the commands are ours."""
    sources = [path for argument in of("COPY") if "--from" not in argument for path in argument.split()[:-1]]
    assert [] == [path for path in sources if not (REPO / path).exists()]
    command = re.findall(r'"([^"]+)"', of("CMD")[0])
    for words in (command, *(one["command"] for one in OURS.values() if "command" in one)):
        full_parser().parse_args(words)


def test_services_are_hardened() -> None:
    """Ours have a read-only root, no capability and no way to new privileges, and share the socket."""
    assert {"tpmsd", "mqtt"} == set(OURS)
    for one in OURS.values():
        assert one["read_only"] is True
        assert (["ALL"], ["no-new-privileges:true"]) == (one["cap_drop"], one["security_opt"])
        assert not {"privileged", "cap_add", "devices"} & set(one)
        assert "socket:/run/tpmsd" in one["volumes"]
        named = {volume.split(":")[0] for volume in one["volumes"] if not volume.startswith(".")}
        assert named <= set(COMPOSE["volumes"])
