"""Are the tests tested? Changes the program in one place at a time and sees whether a test fails.

In: packages, and how many places of each (`tests/mutation/table.py`). Out: a line per mutant that no test
killed, and the share killed. Exit code 1 if a mutation by name survived or the share of the sample is below
the bar. A mutant of the sample meets the package's tests that run its line (`covering`), the quickest first,
up to the first that fails. Works on a copy below build/mutation. Needs the extra `mutation`: cosmic-ray's
operators make the sample. `make mutation` runs it.

    python -m tests.mutation.run --named
    python -m tests.mutation.run --sample 40 --seed 2 state_file timeline
    python -m tests.mutation.run --sample 40 --seed 2 --page      the tables of bench/results/mutation.md
"""

from __future__ import annotations

import argparse
import ast
import compileall
import difflib
import importlib
import os
import re
import shutil
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.mutation.covering import Covering, Recorder
from tests.mutation.reasons import REASONS
from tests.mutation.table import NAMED, PACKAGES, Package

REPO = Path(__file__).resolve().parents[2]
TREE = REPO / "build" / "mutation"
BAR = 0.90
OPERATORS_LEFT_OUT = ("VariableReplacer", "VariableInserter", "RemoveDecorator")
"""The first two take arguments; decorators say how a class is stored (slots, frozen), not what it does."""
PATIENCE = 3.0
"""A mutant that takes this many times the time of the tests has hung, and is killed by that."""
WARM = ("can", "cantools", "hypothesis", "numpy", "pytest", "scipy.special", "scipy.stats", "serial")
"""Imported once; each mutant's tests run in a fork of this process."""


class _Plain(ast.NodeTransformer):
    """Takes out what is no behaviour: annotations, docstrings, decorators."""

    def _function(self, node: ast.FunctionDef | ast.ClassDef) -> ast.AST:
        node.decorator_list = []
        if isinstance(node, ast.FunctionDef):
            node.returns = None
        self.generic_visit(node)
        return node

    visit_FunctionDef = visit_ClassDef = _function  # noqa: N815

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = ast.Constant(None)
        self.generic_visit(node)
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        if isinstance(node.value, ast.Constant):
            node.value = ast.Constant(None)
        self.generic_visit(node)
        return node


def behaviour(source: str) -> str:
    """The program's text as far as it acts; empty if it is none."""
    try:
        return ast.dump(_Plain().visit(ast.parse(source)))
    except SyntaxError:
        return ""


def places(source: str) -> list[list[tuple[str, int]]]:
    """Where cosmic-ray's operators apply: of each place, operators with the number of their occurrence."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    tree, found = get_ast(source), defaultdict(list)
    for name in sorted(operator_names()):
        if name.endswith(OPERATORS_LEFT_OUT):
            continue
        operator, occurrence = get_operator(name)(), 0
        for node in ast_nodes(tree):
            for place in operator.mutation_positions(node):
                found[place].append((name, occurrence))
                occurrence += 1
    return [found[place] for place in sorted(found)]


def sampled(modules: tuple[str, ...], count: int, rng: np.random.Generator) -> list[tuple[str, str]]:
    """Up to `count` mutants, (module, its mutated text): places without replacement, one operator each."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    sources = {module: (REPO / module).read_text("utf-8") for module in modules}
    everywhere = [(module, place) for module in modules for place in places(sources[module])]
    mutants: list[tuple[str, str]] = []
    for index in rng.permutation(len(everywhere)):
        if len(mutants) == count:
            break
        module, place = everywhere[index]
        name, occurrence = place[rng.integers(len(place))]
        text = mutate_code(sources[module], get_operator(name)(), occurrence)
        if text is not None and behaviour(text) not in ("", behaviour(sources[module])):
            mutants.append((module, text))
    return mutants


def named() -> list[tuple[str, str, tuple[str, ...]]]:
    """The mutations by name: (module, its mutated text, tests). None may be stale."""
    stale = [
        f"{m.module}: {m.old!r}" for m in NAMED if (REPO / m.module).read_text("utf-8").count(m.old) != 1
    ]
    if stale:
        raise SystemExit("\n".join(["not found exactly once:", *stale]))
    return [
        (one.module, (REPO / one.module).read_text("utf-8").replace(one.old, one.new), one.tests)
        for one in NAMED
    ]


def copy_tree() -> None:
    """The program and its tests where they may be changed, with everything compiled."""
    shutil.rmtree(TREE, ignore_errors=True)
    ignore = shutil.ignore_patterns("__pycache__", ".hypothesis")
    for name in ("tpmsd", "tests", "dbc", "bench", "docs"):
        shutil.copytree(REPO / name, TREE / name, ignore=ignore)
    shutil.copy(REPO / "pyproject.toml", TREE)
    compileall.compile_dir(TREE / "tpmsd", quiet=1)


def fails(
    tests: Sequence[str], left_out: str, limit_s: float, recorded: tuple[tuple[str, ...], Path] | None = None
) -> bool:
    """Whether the tests of the copy fail as it is now (or hang), in a process of their own.

    With `recorded`, lines of these modules are kept in that file.
    """
    priority = _autogroup()
    child = os.fork()
    if child == 0:
        os.setsid()
        _autogroup(priority)
        signal.alarm(int(limit_s) + 1)
        os.chdir(TREE)
        os.environ["PYTHONPATH"] = str(TREE)
        sys.path.insert(0, str(TREE))
        for name in [name for name in sys.modules if name.split(".")[0] in ("tests", "tpmsd")]:
            del sys.modules[name]
        log = os.open("build.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for descriptor in (1, 2):  # of one position: neither writes over the other
            os.dup2(log, descriptor)
        import hypothesis
        import pytest

        # A busy machine draws slowly, which is no failure of the program's.
        slow = [hypothesis.HealthCheck.too_slow]
        hypothesis.settings.register_profile("mutation", suppress_health_check=slow, deadline=None)
        hypothesis.settings.load_profile("mutation")
        recorder = Recorder(*recorded) if recorded is not None else None
        if recorder is not None:
            recorder.start()
        options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *tests]
        options += ["-k", f"not ({left_out})"] if left_out else []
        code = pytest.main(options, plugins=[] if recorder is None else [recorder])
        if recorder is not None:
            recorder.save()
        os._exit(code)
    _, status = os.waitpid(child, 0)
    unread = "ERROR collecting" in (TREE / "build.log").read_text("utf-8", "replace")  # the mutant's import
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) in (4, 5) and not unread:
        raise SystemExit(f"no tests ran: {tests}; see {TREE / 'build.log'}")
    return status != 0


def _autogroup(nice: str | None = None) -> str | None:
    """Return the priority of this session among others, and set it to `nice`; None where Linux has none.

    A new session begins with the usual one: its tests would take the processor from whoever works beside.
    """
    file = Path("/proc/self/autogroup")
    try:
        if nice is not None:
            file.write_text(nice, "ascii")
        return file.read_text("ascii").split()[-1]
    except OSError:
        return None


def killed(module: str, text: str, tests: Sequence[str], left_out: str, limit_s: float) -> bool:
    """Whether the tests notice the mutant; the copy is whole again afterwards. Without tests none does."""
    if not tests:
        return False
    target = TREE / module
    for compiled in (target.parent / "__pycache__").glob(f"{target.stem}.*"):
        compiled.unlink()
    target.write_text(text, "utf-8")
    try:
        return fails(tests, left_out, limit_s)
    finally:
        shutil.copy(REPO / module, target)


def shown(module: str, text: str) -> str:
    """What the mutant changed, on one line."""
    before = (REPO / module).read_text("utf-8").splitlines()
    changes = difflib.unified_diff(before, text.splitlines(), n=0, lineterm="")
    at, lines = "?", []
    for line in list(changes)[2:]:
        if line.startswith("@@"):
            at = line.split()[1][1:].partition(",")[0]
        else:
            lines.append(f"{line[0]} {line[1:].strip()}")
    return f"{module}:{at}  {'   '.join(lines)}"


def changed_line(module: str, text: str) -> int:
    """The first line of the module that the mutant changes."""
    before = (REPO / module).read_text("utf-8").splitlines()
    changes = difflib.SequenceMatcher(None, before, text.splitlines(), autojunk=False).get_opcodes()
    return next((low + 1 for tag, low, *_ in changes if tag != "equal"), 1)


def seen_lines(name: str, package: Package) -> Covering:
    """Run the tests of a package without a mutation, and keep which lines each of them runs."""
    file = TREE.parent / f"mutation-{name}.json"
    modules = tuple(str(TREE / module) for module in package.modules)
    if fails(package.tests, package.left_out, 3600.0, (modules, file)):
        raise SystemExit(f"{' '.join(package.tests)} fail without a mutation; see {TREE / 'build.log'}")
    return Covering.load(file, TREE)


@dataclass
class Judged:
    """What came of the sample of a package."""

    name: str
    seen: int = 0
    survivors: list[tuple[str, str]] = field(default_factory=list)
    """Module, and the change on one line."""

    @property
    def dead(self) -> int:
        return self.seen - len(self.survivors)


def judge(name: str, sample: int, seed: int, until_s: float, every: bool) -> Judged:
    """Judge a sample of the package; ends early when the clock passes `until_s`."""
    package, rng = PACKAGES[name], np.random.default_rng([seed, *name.encode("ascii")])
    covering, judged = seen_lines(name, package), Judged(name)
    for module, text in sampled(package.modules, sample, rng):
        if time.monotonic() > until_s:
            break
        tests = covering.tests(module, (REPO / module).read_text("utf-8"), changed_line(module, text))
        limit_s = 20.0 + PATIENCE * sum(covering.taken_s[test] for test in tests)
        died = killed(module, text, tests, "", limit_s)
        judged.seen += 1
        if not died:
            judged.survivors.append((module, shown(module, text)))
        if every or not died:
            print(f"  {'killed' if died else 'survived'}: {shown(module, text)}", flush=True)
    print(f"{name:14s} {judged.dead:3d} of {judged.seen:3d} killed", flush=True)
    return judged


def reason(change: str) -> str:
    """The reason that the table gives for a survivor; empty where there is none."""
    return next((why for piece, why in REASONS.items() if piece in change), "")


def page(packages: list[Judged], sample: int, seed: int) -> str:
    """The tables of bench/results/mutation.md."""
    lines = ["| package | mutants | killed | without those that change nothing |", "| --- " * 4 + "|"]
    for package in packages:
        same = sum(reason(change).startswith("same") for _, change in package.survivors)
        share = f"{package.dead} of {package.seen - same}"
        lines.append(f"| {package.name} | {package.seen} | {package.dead} | {share} |")
    names = " ".join(package.name for package in packages)
    lines += ["", f"`python -m tests.mutation.run --sample {sample} --seed {seed} {names}`"]
    lines += ["", "| survivor | mutation | reason |", "| --- | --- | --- |"]
    tested = 0
    for package in packages:
        for _, change in package.survivors:
            if reason(change).startswith(("has a test", "held by")):
                tested += 1
            elif not reason(change).startswith("same"):
                place, edit = abridged(change)
                lines.append(f"| `{place}` | {edit} | {reason(change) or 'missed'} |")
    return "\n".join(
        [*lines, "", f"{tested} other survivors have a test, or one outside the package holds them."]
    )


def abridged(change: str) -> tuple[str, str]:
    """Return file and line of a change that `shown` printed, and the words that differ, before and after."""
    found = re.fullmatch(r"(\S+)  - (.*?)   \+ (.*)", change)
    if found is None:
        return change.replace("|", "\\|"), ""
    place, *lines = found.groups()
    before, after = (re.findall(r"\w+(?:\.\w+)*|[^\w\s]+", line) for line in lines)
    head = next((k for k, (one, other) in enumerate(zip(before, after, strict=False)) if one != other), 0)
    backward = zip(before[::-1], after[::-1], strict=False)
    tail = next((k for k, (one, other) in enumerate(backward) if one != other), 0)
    tail = min(tail, len(before) - head, len(after) - head)
    near = max(head - 1, 0)
    cells = (" ".join(words[near : len(words) - tail]).replace("|", "\\|") for words in (before, after))
    return place.removeprefix("tpmsd/"), " to ".join(f"`{cell}`" for cell in cells)


def printed(text: str) -> list[Judged]:
    """Return the packages of which an earlier run printed survivors and their number."""
    packages, survivors = [], []
    for line in text.splitlines():
        if line.startswith("  survived: "):
            change = line.removeprefix("  survived: ")
            survivors.append((change.partition(":")[0], change))
        elif found := re.fullmatch(r"(\w+) +(\d+) of +(\d+) killed", line):
            packages.append(Judged(found[1], int(found[3]), survivors))
            survivors = []
    return packages


def judge_named() -> int:
    """Judge the mutations by name; 1 if one survives."""
    limits: dict[tuple[str, ...], float] = {}
    total = dead = 0
    for module, text, tests in named():
        if tests not in limits:
            began = time.monotonic()
            if fails(tests, "", 3600.0):
                raise SystemExit(f"{' '.join(tests)} fail without a mutation; see {TREE / 'build.log'}")
            limits[tests] = 20.0 + PATIENCE * (time.monotonic() - began)
        died = killed(module, text, tests, "", limits[tests])
        total, dead = total + 1, dead + died
        if not died:
            print(f"  survived: {shown(module, text)}", flush=True)
    print(f"{dead} of {total} killed")
    return 0 if dead == total else 1


def main() -> int:
    """Run the mutations by name, or the sample of the packages."""
    parser = argparse.ArgumentParser(description="mutation testing")
    parser.add_argument("--named", action="store_true", help="only the mutations by name")
    parser.add_argument("--sample", type=int, default=25, help="places of each package")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--all", action="store_true", help="a line for killed mutants, too")
    parser.add_argument("--page", action="store_true", help="print tables for bench/results/mutation.md")
    parser.add_argument(
        "--minutes", type=float, default=1e6, help="for each package; it ends early after these"
    )
    parser.add_argument("--of", type=Path, metavar="FILE", help="print these tables of an earlier run's text")
    parser.add_argument("packages", nargs="*", help=f"default: all of {' '.join(PACKAGES)}")
    args = parser.parse_args()
    if unknown := sorted(set(args.packages) - set(PACKAGES)):
        parser.error(f"no such package: {' '.join(unknown)}")
    if args.of is not None:
        print(page(printed(args.of.read_text("utf-8")), args.sample, args.seed))
        return 0
    sys.dont_write_bytecode = True
    copy_tree()
    for name in WARM:
        importlib.import_module(name)
    if args.named:
        return judge_named()
    packages = [
        judge(name, args.sample, args.seed, time.monotonic() + 60.0 * args.minutes, args.all)
        for name in args.packages or PACKAGES
    ]
    if args.page:
        print(f"\n{page(packages, args.sample, args.seed)}\n")
    dead, total = sum(package.dead for package in packages), sum(package.seen for package in packages)
    print(f"{dead} of {total} killed, {100.0 * dead / max(total, 1):.0f} %")
    return 0 if dead >= BAR * total else 1


if __name__ == "__main__":
    sys.exit(main())
