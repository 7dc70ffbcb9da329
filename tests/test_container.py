"""The container's files as text: what they promise stands in them, and what they run exists."""

from __future__ import annotations

import re
import tomllib
from typing import Any

import yaml

from tests.conftest import REPO
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


def test_what_is_installed_and_run_exists() -> None:
    """The extras are those of pyproject.toml, copied files are here, and the commands are ours."""
    project = tomllib.loads((REPO / "pyproject.toml").read_text("utf-8"))["project"]
    extras = re.search(r"'\.\[([a-z,]+)\]'", " ".join(of("RUN")))
    assert extras is not None
    assert set(extras[1].split(",")) <= set(project["optional-dependencies"])
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
