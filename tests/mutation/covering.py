"""Which tests run which lines: those that can notice a mutant there, the quickest first.

In: one run of a package's tests, recorded by coverage.py with a context of its own for each test. Out: for a
changed line, the tests that ran its statement. A line that runs while its module is imported is judged by all
tests of the package, those that run anything of its module first.
"""

from __future__ import annotations

import ast
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest


def function(nodeid: str) -> str:
    """Return pytest's name of a test without its parameters, which may hold any character."""
    return nodeid.partition("[")[0]


class Recorder:
    """A plugin of pytest: keeps the lines that each test runs, and how long it takes."""

    def __init__(self, modules: tuple[str, ...], out: Path) -> None:
        import coverage

        self._out = out
        self._coverage = coverage.Coverage(data_file=None, include=list(modules), branch=False)
        self._taken_s: dict[str, float] = {}

    def start(self) -> None:
        """Begin, before any of the modules is imported."""
        self._coverage.start()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Any:
        self._coverage.switch_context(function(item.nodeid))
        try:
            return (yield)
        finally:
            self._coverage.switch_context("")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        name = function(report.nodeid)
        self._taken_s[name] = self._taken_s.get(name, 0.0) + report.duration

    def save(self) -> None:
        """Write what was recorded, as JSON."""
        self._coverage.stop()
        data = self._coverage.get_data()
        lines = {file: data.contexts_by_lineno(file) for file in data.measured_files()}
        self._out.write_text(json.dumps({"taken_s": self._taken_s, "lines": lines}), "utf-8")


def statement_lines(source: str, line: int) -> range:
    """Return the lines of the innermost statement at `line`; of a compound one, those of its head."""
    inner: tuple[int, range] | None = None
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.stmt) or node.end_lineno is None:
            continue
        body = getattr(node, "body", None)
        end = body[0].lineno - 1 if isinstance(body, list) and body else node.end_lineno
        span = range(node.lineno, max(end, node.lineno) + 1)
        if line in span and (inner is None or len(span) <= inner[0]):
            inner = len(span), span
    return range(line, line + 1) if inner is None else inner[1]


@dataclass(frozen=True)
class Covering:
    """The tests of a package, by the lines that they run."""

    taken_s: dict[str, float]
    lines: dict[str, dict[int, list[str]]]
    """Of each module: the tests at each line; "" stands for the import."""

    @classmethod
    def load(cls, file: Path, tree: Path) -> Covering:
        """Read what `Recorder` wrote; modules are named from `tree` on."""
        made = json.loads(file.read_text("utf-8"))
        lines = {
            str(Path(name).resolve().relative_to(tree.resolve())): {int(k): v for k, v in at.items()}
            for name, at in made["lines"].items()
        }
        return cls(made["taken_s"], lines)

    def tests(self, module: str, source: str, line: int) -> list[str]:
        """Return the tests that can notice a change of this line, the quickest first; none if none can."""
        there = self.lines.get(module, {})
        found = {test for at in statement_lines(source, line) for test in there.get(at, ())}
        if "" in found:
            near = {test for tests in there.values() for test in tests} - {""}
            return sorted(self.taken_s, key=lambda test: (test not in near, self.taken_s[test]))
        return sorted(found & self.taken_s.keys(), key=self.taken_s.__getitem__)
