"""Every example of README, docs and CONTRIBUTING is run, or says why it is not and is at least what the
parser takes.

A block of commands is `console`, each command after `$ `, what it prints below it. Without a language it
needs a comment `<!-- not run: REASON -->` before it. `<!-- run with: --option value -->` takes the place of
options of the same name, so that the run is shorter than what is printed. `<!-- output: compared -->` says
that what stands below a command is what it prints: words must be the same, numbers the same within 5 %, for
other processors round otherwise; lines may be broken elsewhere, and `...` leaves some out.
"""

from __future__ import annotations

import pkgutil
import re
import shlex
import subprocess
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tpmsd.interfaces.cli.main import full_parser, main

REPO = Path(__file__).resolve().parent.parent
PAGES = [
    REPO / "README.md",
    REPO / "CONTRIBUTING.md",
    REPO / "SECURITY.md",
    *sorted((REPO / "docs").rglob("*.md")),
]
BLOCK = re.compile(
    r"(?:^<!-- (not run|run with|output): ([^\n]*) -->\n)?^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL
)
NO_COMMANDS = ("text", "toml", "json", "python", "sh")
PARSER = full_parser()


BIBLIOGRAPHY = (REPO / "docs" / "reference" / "bibliography.md").read_text(encoding="utf-8")
ENTRY = re.compile(r"^- \[(\S.*?) (\d{4})\] (.*)$", re.MULTILINE)
"""Author, year and text of an entry; one without a year is named by its method."""
NAME = r"(?:de )?[^\W\d_a-z][^\W\d_]+"
YEAR = r"((?:19|20)\d\d)"
CITED = re.compile(rf"\[({NAME}) {YEAR}\]|({NAME})(?:(?:,|\s+and)\s+(?:{NAME}|others))*\s+\(?{YEAR}[);]")
"""A citation as a link, [Lundquist 2013], and in words, (Davison and Hinkley 1997) or Liu (2022)."""


RESULTS = sorted((REPO / "bench" / "results").glob("*.md"))
SUFFIX = r"\.(?:py|c|h|md|toml|svg|png|dbc|service|json|cfg)"
FILE = re.compile(rf"`([\w./-]+{SUFFIX}|(?:tpmsd|bench|tests|tools|docs)(?:/[\w.-]+)+/?)(?::\d+)?`")
"""A file or folder of the repository in words: `tests/language.py`, `inference/reading`."""
DOTTED = re.compile(r"`(tpmsd(?:\.\w+)+)`")
"""A module or a name in one: `tpmsd.foundation.errors`, `tpmsd.ConfigError`."""
ELSEWHERE = re.compile(
    # of a user, a topic of MQTT, made by a contributor, made by a command
    r"/.*|[\w-]+\.(?:toml|json|png|md)|tpmsd/car/(?:state|alarms|event|availability)"
    r"|.*aerodynamic_lift\.py|build/.*|\w+/(?:vehicle|truth|provenance|run)\.(?:toml|json)|tpmsd\.effects"
)
"""Names that look like files or modules of the repository, and are none."""


@dataclass(frozen=True)
class Block:
    """One fenced block of a page."""

    name: str
    mark: str
    reason: str
    language: str
    text: str


def blocks() -> Iterator[Block]:
    """All of them, in the order of the pages."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in BLOCK.finditer(text):
            line = text.count("\n", 0, match.start(3)) + 1
            yield Block(
                f"{page.relative_to(REPO)}:{line}", match[1] or "", match[2] or "", match[3], match[4]
            )


TRACKED = subprocess.run(
    ["git", "ls-files"], cwd=REPO, capture_output=True, text=True, check=False
).stdout.splitlines() or [str(path.relative_to(REPO)) for path in REPO.rglob("*")]
ALL = list(blocks())
CONSOLE = [block for block in ALL if block.language == "console"]
PYTHON = [
    block for block in ALL if block.language == "python" and block.name.startswith("docs/how-to/python")
]


def commands(block: Block) -> list[list[str]]:
    """The words of each command of `tpmsd` in a block that is not run, without where its output goes."""
    lines = [line.partition(" > ")[0] for line in block.text.replace("\\\n", " ").splitlines()]
    words = [shlex.split(line.removeprefix("$ "), comments=True) for line in lines if "tpmsd " in line]
    return [each[1:] for each in words if each and each[0] == "tpmsd"]


def test_every_block_is_run_or_says_why_not() -> None:
    """No fence is left open, and a block without a language has its reason."""
    fences = {page: page.read_text(encoding="utf-8").count("\n```") for page in PAGES}

    assert [] == [str(page) for page, count in fences.items() if count % 2]
    assert sum(fences.values()) // 2 == len(ALL)
    assert [] == [
        block.name
        for block in ALL
        if block.language not in (*NO_COMMANDS, "console") and not (block.mark == "not run" and block.reason)
    ]


def test_every_citation_is_resolved_once() -> None:
    """Author and year, in pages and docstrings alike; an entry begins with that author."""
    entries = ENTRY.findall(BIBLIOGRAPHY)
    keys = [(author, year) for author, year, _ in entries]
    texts = {str(page): page.read_text(encoding="utf-8") for page in PAGES}
    for module in (REPO / "tpmsd").rglob("*.py"):
        # In the code only the form in brackets: prose there names authors with their journals.
        texts[str(module)] = " ".join(re.findall(r"\[\S+ \d{4}\]", module.read_text(encoding="utf-8")))
    cited = [
        (page, one[0] or one[2], one[1] or one[3]) for page in texts for one in CITED.findall(texts[page])
    ]

    assert [] == [one for one in cited if one[1:] not in keys]
    assert len(keys) == len(set(keys))
    assert [] == [key for *key, text in entries if not text.startswith(key[0])]
    assert len(keys) < len(cited)


def absent_names(text: str) -> list[str]:
    """Return the files, folders and modules that a text names and that do not exist, in order.

    A path may leave out its first folders; a word in capitals (`effects/NAME.py`) stands for any name.
    """
    absent = []
    for name in FILE.findall(text):
        parts = re.sub(r"(?<![A-Za-z])[A-Z]{2,}(?![A-Za-z])", "*", name.strip("/").removeprefix("./"))
        wanted = re.compile(r"(?:.*/)?" + re.escape(parts).replace(r"\*", "[^/]+") + r"(?:/.*)?")
        if not ELSEWHERE.fullmatch(name) and not any(map(wanted.fullmatch, TRACKED)):
            absent.append(name)
    for name in DOTTED.findall(text):
        if not ELSEWHERE.fullmatch(name) and not resolves(name):
            absent.append(name)
    return absent


def resolves(dotted: str) -> bool:
    """Return whether a dotted name can be imported, as a module or as an attribute of one."""
    try:
        pkgutil.resolve_name(dotted)
    except (ImportError, AttributeError):
        return False
    return True


def test_files_and_modules_that_pages_name_exist() -> None:
    """Every path and dotted name in README, docs, CONTRIBUTING and the results is one of the repository."""
    found = {page.name: absent_names(page.read_text(encoding="utf-8")) for page in [*PAGES, *RESULTS]}

    assert {} == {name: absent for name, absent in found.items() if absent}


RESULTS_WORDS = 15_000
"""Words of all pages of results together, tables included."""


def test_the_pages_of_results_do_not_grow() -> None:
    """All pages of bench/results together hold at most `RESULTS_WORDS` words."""
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in RESULTS) <= RESULTS_WORDS


def test_a_file_or_module_that_does_not_exist_is_found() -> None:
    """A wrong folder, a module that moved and a name that is not exported are found."""
    text = "`tests/language.py`, `inference/language.py`, `effects/NAME.py`, `tpmsd.ConfigError`, `tpmsd.Nil`"

    assert ["inference/language.py", "tpmsd.Nil"] == absent_names(text)


def test_commands_that_are_not_run_are_such_as_the_parser_takes() -> None:
    """Every command and option that a page shows exists."""
    unknown = []
    for block in ALL:
        if block.language in NO_COMMANDS or block.language == "console":
            continue
        for words in commands(block):
            try:
                PARSER.parse_args(words)
            except (SystemExit, Exception) as error:
                unknown.append(f"{block.name}: {' '.join(words)}: {error}")
    assert [] == unknown


@pytest.mark.parametrize("block", [b for b in ALL if b.language == "toml"], ids=lambda block: block.name)
def test_configurations_are_toml(block: Block) -> None:
    """Each block of TOML is one."""
    assert tomllib.loads(block.text)


def shortened(words: list[str], instead: list[str]) -> list[str]:
    """A command with other values; an option that it has not is added where it is a switch of `diagnose`."""
    words = list(words)
    for option, value in zip(instead[::2], instead[1::2], strict=True):
        if option in words:
            words[words.index(option) + 1] = value
        elif option == "--certify" and words[0] == "diagnose":
            words += [option, value]
    return words


@pytest.mark.parametrize("block", CONSOLE, ids=lambda block: block.name)
def test_an_example_runs(
    block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each command ends well, or with the very error that is printed below it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drives").mkdir()
    instead = shlex.split(block.reason) if block.mark == "run with" else []
    for part in block.text.split("$ tpmsd ")[1:]:
        command, *shown = part.rstrip("\n").split("\n")
        code = main(shortened(shlex.split(command), instead))
        said = capsys.readouterr()
        if block.mark == "output":
            assert 0 == code, said.err
            assert [] == not_printed("\n".join(shown), said.out)
            continue
        assert (2 if shown else 0) == code, said.err
        assert [] == [line for line in shown if line not in said.err + said.out]


NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
SAME = 0.05
"""Relative difference within which a printed number is the same."""


def same_word(one: str, other: str) -> bool:
    """Words that differ in their numbers alone, by 5 % at most."""
    if NUMBER.sub("#", one) != NUMBER.sub("#", other):
        return False
    pairs = zip(NUMBER.findall(one), NUMBER.findall(other), strict=True)
    return all(float(a) == pytest.approx(float(b), rel=SAME) for a, b in pairs)


def not_printed(shown: str, said: str) -> list[str]:
    """The parts of an example, between lines of `...`, that do not stand in what was printed, in order."""
    words, at, missing = said.split(), 0, []
    for part in re.split(r"^\.\.\.$", shown, flags=re.MULTILINE):
        wanted = part.split()
        starts = range(at, len(words) - len(wanted) + 1)
        found = next((k for k in starts if all(map(same_word, wanted, words[k : k + len(wanted)]))), None)
        if found is None:
            missing.append(part)
        else:
            at = found + len(wanted)
    return missing


def test_an_example_with_another_output_is_seen() -> None:
    """Another word, a number 6 % off, another order are all told; broken lines and small changes are not."""
    said = "It reads 4.00 % low (0.9600 +- 0.0008).\n\nfound: 3\nlast 1.5e-06 s2/m"

    assert [] == not_printed("It reads 4.00 %\nlow (0.9600 +- 0.00081).\n...\nlast 1.52e-06 s2/m", said)
    assert 1 == len(not_printed("It reads 4.00 % high", said))
    assert 1 == len(not_printed("It reads 4.25 % low", said))
    assert 1 == len(not_printed("last 1.5e-06 s2/m\n...\nfound: 3", said))
    assert 1 == len(not_printed("It reads 4.00 % low (0.9600 +- 0.0008). last", said))


def test_the_examples_of_the_python_api_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks of the page, one after the other in one namespace, with drives and arrays to work on."""
    monkeypatch.chdir(tmp_path)
    for seed, day in enumerate(("monday", "tuesday")):
        assert 0 == main(["simulate", f"drives/{day}", "--duration", "95", "--seed", str(seed + 1)])
    t, tg = np.arange(0.0, 60.0, 0.02), np.arange(0.0, 60.0, 0.2)
    rolling = np.full_like(t, 15.0 / 0.316)
    names: dict[str, object] = {
        "t": t,
        "tg": tg,
        "r": 0.0 * t,
        "v": np.full_like(tg, 15.0),
        "course": 0.0 * tg,
    }
    names |= {"fl": rolling, "fr": rolling, "rl": rolling, "rr": rolling}
    names |= {"lat": 52.5 + 15.0 * tg / 111_200.0, "lon": np.full_like(tg, 13.4)}
    for block in PYTHON:
        exec(compile(block.text, block.name, "exec"), names)

    assert (tmp_path / "drives" / "made" / "vehicle.toml").is_file()
