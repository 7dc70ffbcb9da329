"""The house rules that a machine can watch: who may import whom, what stays pure, how modules look.

`docs/explanation/architecture.md` explains the rules; the tables here are what they come to.
"""

from __future__ import annotations

import ast
import functools
import itertools
import re
import subprocess
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pytest

from tests.language import OTHERS, found_in

REPO = Path(__file__).resolve().parent.parent
PACKAGE = REPO / "tpmsd"
BENCH = REPO / "bench"
TESTS = REPO / "tests"

LAYERS = ("interfaces", "offline", "onboard", "car", "foundation")
"""From the top down: a layer may import those after it."""
_CORE_FLOW = ("sources", "timeline", "estimators", "monitor", "sinks")
"""The direction of flow in the car: each imports only what lies before it."""
WITHIN: dict[str, set[str]] = {
    package: set(_CORE_FLOW[:position]) for position, package in enumerate(_CORE_FLOW)
} | {
    # interfaces
    "cli": {"api", "bridges", "web"},
    "web": {"api"},
    "api": set(),
    "bridges": set(),
    # offline
    "fleet": {"calibration", "diagnosis", "drives", "report", "tables"},
    "planning": {"diagnosis", "inference", "simulator"},
    "drives": {"discovery", "inference", "report", "tables"},
    "report": {"diagnosis", "dynamics"},
    "diagnosis": {"drive_checks", "inference", "rings"},
    "drive_checks": {"discovery", "inference"},
    "calibration": {"inference"},
    "inference": set(),
    "discovery": {"rings"},
    "rings": {"inference"},  # that of offline; the package of this name in car imports none
    "signals": {"dynamics", "tables"},
    "dynamics": {"diagnosis"},
    "simulator": {"inference"},
    "tables": set(),
    # onboard
    "daemon": {*_CORE_FLOW, "pipeline", "resonance"},
    "pipeline": {*_CORE_FLOW, "resonance"},
    "resonance": {"sources"},
    # car
    "vehicle_state": {"config", "physics"},
    "physics": {"config", "rings"},
    "config": set(),
    "cars": set(),
}
"""What a package may import within its layer; modules of `foundation` may import each other."""
for _package in ("monitor", "sinks"):
    WITHIN[_package].add("resonance")

PURE_PACKAGES = {
    *("sources", "timeline", "estimators", "monitor", "pipeline"),
    *(
        "physics",
        "dynamics",
        "discovery",
        "vehicle_state",
        "resonance",
        "rings",
        "drive_checks",
        "diagnosis",
        "bounds",
        "errors",
        "wheels",
    ),
}
SHELLS = {
    "tpmsd.onboard.sources.drive",
    *(f"tpmsd.onboard.sources.can.{name}" for name in ("live", "log", "log_candump", "log_others")),
    *(f"tpmsd.onboard.sources.gnss.{name}" for name in ("net_live", "nmea_log", "serial_live")),
    *("tpmsd.car.physics.model_file", "tpmsd.car.physics.own_effects"),
}
"""Modules of these packages that open files and devices; the others only work on what those read."""
SEEDS = {"pipeline"}
"""Where generators are made, from the configured seed."""
# pathlib is no offence: a path is a name, which a pure module may carry in an error; opening it is below.
IMPURE_MODULES = {
    *(
        "asyncio",
        "fcntl",
        "glob",
        "http",
        "io",
        "logging",
        "multiprocessing",
        "os",
        "queue",
        "random",
        "sched",
    ),
    *(
        "secrets",
        "select",
        "selectors",
        "serial",
        "shutil",
        "signal",
        "socket",
        "subprocess",
        "sys",
        "tempfile",
    ),
    *("threading", "time", "urllib", "uuid"),
}
IMPURE_CALLS = {"open", "print", "input"}
IMPURE_METHODS = {
    *("now", "utcnow", "today"),
    *("read_text", "read_bytes", "write_text", "write_bytes", "exists", "is_file", "is_dir", "iterdir"),
}
RANDOM_TYPES = {"Generator", "BitGenerator"}
"""Randomness comes in as an argument; of numpy.random the core may name only its types."""

RECORDS = (
    "tpmsd.foundation.wheels",
    "tpmsd.onboard.timeline.tick",
    "tpmsd.onboard.sources.events",
    "tpmsd.car.config.model",
)
"""Modules of plain records: all that the worlds of the benchmarks may import of the program."""

MAX_BRANCHES = 15


@functools.cache
def modules() -> tuple[Path, ...]:
    """Every module of the package."""
    return tuple(sorted(PACKAGE.rglob("*.py")))


@functools.cache
def read(path: Path) -> str:
    """Its text, whatever the locale."""
    return path.read_text(encoding="utf-8")


def layer_of(dotted: str) -> str:
    """`tpmsd.onboard.sources.events` -> `onboard`; the package itself -> ``."""
    parts = dotted.split(".")
    return parts[1] if len(parts) > 1 and parts[1] not in ("__init__", "__main__") else ""


def package_of(dotted: str) -> str:
    """`tpmsd.onboard.sources.events` -> `sources`; a layer, and the package itself -> `__init__`."""
    parts = dotted.split(".")
    return parts[2] if len(parts) > 2 else "__init__"


def dotted_name(path: Path) -> str:
    """The module's name as one imports it, `__init__` left in for the package itself."""
    parts = path.relative_to(REPO).with_suffix("").parts
    return ".".join(parts)


@functools.cache
def imports(source: str) -> tuple[tuple[int, str], ...]:
    """Line and full name of everything that is imported, wherever in the module that is done."""
    return tuple(imported(ast.walk(ast.parse(source))))


def imported(tree: Iterable[ast.AST]) -> Iterator[tuple[int, str]]:
    """Line and full name of everything that these nodes import."""
    for node in tree:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield node.lineno, f"{'.' * node.level}{node.module or ''}.{alias.name}"


def direction_faults(module: str, source: str) -> list[str]:
    """What a module imports against the direction of flow, one line each."""
    layer, package = layer_of(module), package_of(module)
    if not layer:
        return []  # `tpmsd/__init__.py` hands out public names, `__main__` runs the command
    if layer not in LAYERS:
        return [f"{module}: there is no layer {layer}; the layers are {', '.join(LAYERS)}"]
    if layer != "foundation" and package not in {"__init__", *WITHIN}:
        return [f"{module}: the package {package} is not in the table of tests/test_house.py"]
    faults = []
    for line, name in imports(source):
        if name.startswith("."):
            faults.append(f"{module}:{line}: relative import {name}; the house writes them in full")
        elif name.split(".")[0] == "tpmsd":
            target, inner = layer_of(name), package_of(name)
            if target not in LAYERS:
                faults.append(f"{module}:{line}: {name} is imported from the layer that has it")
            elif LAYERS.index(target) < LAYERS.index(layer):
                faults.append(
                    f"{module}:{line}: {layer} must not import {target}, which is above it ({name})"
                )
            elif target == layer != "foundation" and inner not in {package, *WITHIN.get(package, set())}:
                faults.append(f"{module}:{line}: {package} must not import {inner} ({name})")
    return faults


def bench_faults(module: str, source: str) -> list[str]:
    """What a module of the benchmarks or the program imports against tests -> bench -> tpmsd, a line each."""
    barred = ["tests", "bench"] if module.startswith("tpmsd") else ["tests"]
    if module.startswith("bench.worlds"):
        barred += ["bench.campaigns", "tpmsd"]
    faults = []
    for line, name in imports(source):
        within = [root for root in barred if name == root or name.startswith(f"{root}.")]
        if within and not name.startswith(RECORDS):
            faults.append(f"{module}:{line}: must not import {name}")
    return faults


def is_pure(module: str) -> bool:
    """Whether a module belongs to the core that does no I/O and reads no clock."""
    return package_of(module) in PURE_PACKAGES and module not in SHELLS


def purity_faults(module: str, source: str) -> list[str]:
    """I/O, clocks and hidden randomness in a module of the core, one line each."""
    tree = ast.parse(source)
    seeded = {
        id(node.func)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and node.args and package_of(module) in SEEDS
    }
    faults = [f"{module}:{line}: {fault}" for line, name in imports(source) for fault in impure_import(name)]
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and id(node) not in seeded:
            if node.attr not in RANDOM_TYPES and ast.unparse(node.value) in ("np.random", "numpy.random"):
                fault = f"randomness must come in as a Generator, not {node.attr}"
                faults.append(f"{module}:{node.lineno}: {fault}")
        elif isinstance(node, ast.Call) and (called := impure_call(node.func)):
            faults.append(f"{module}:{node.lineno}: the core must not call {called}()")
    return faults


def impure_import(name: str) -> list[str]:
    """The objections to the core's import of a module or of a name in one, none where it is pure."""
    faults = []
    if name.split(".")[0] in IMPURE_MODULES:
        faults.append(f"the core must not import {name}")
    if name.startswith("numpy.random.") and name.rsplit(".", 1)[-1] not in RANDOM_TYPES:
        faults.append(f"randomness must come in as a Generator, not {name}")
    return faults


def impure_call(called: ast.expr) -> str:
    """The function or `.method` that does I/O or reads a clock; empty where what is called does not."""
    if isinstance(called, ast.Name) and called.id in IMPURE_CALLS:
        return called.id
    if isinstance(called, ast.Attribute) and called.attr in IMPURE_METHODS:
        return f".{called.attr}"
    return ""


def tracked_files() -> list[Path]:
    """All files of the project as git knows them."""
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=REPO, capture_output=True, text=True)
    if listing.returncode != 0:
        pytest.skip("not a git checkout")
    return [REPO / name for name in listing.stdout.split("\0") if name and (REPO / name).is_file()]


def test_imports_follow_the_flow() -> None:
    """No package imports a package that lies further down the flow."""
    assert [] == [fault for path in modules() for fault in direction_faults(dotted_name(path), read(path))]


def test_tests_import_the_bench_and_the_bench_the_program() -> None:
    """Never the other way round; the worlds take no more of the program than its plain records."""
    assert [] == [
        fault
        for root in (PACKAGE, BENCH)
        for path in sorted(root.rglob("*.py"))
        for fault in bench_faults(dotted_name(path), read(path))
    ]


@pytest.mark.parametrize(
    ("module", "source", "faults"),
    [
        (
            "bench.campaigns.x",
            "from bench.worlds.spec import Spec\nfrom tpmsd.onboard.pipeline import Pipeline",
            0,
        ),
        ("bench.campaigns.x", "from tests.offline.calibration import drives", 1),
        ("bench.worlds.x", "from tpmsd.onboard.timeline.tick import Fix, Tick", 0),
        ("bench.worlds.x", "from tpmsd.onboard.timeline.timeline import Timeline", 1),
        ("bench.worlds.x", "from bench.campaigns.offline.diagnosis import draw", 1),
        ("tpmsd.offline.report.x", "import bench.statistics", 1),
    ],
)
def test_the_watch_over_the_bench_sees(module: str, source: str, faults: int) -> None:
    """An import of tests, of campaigns by worlds, or of the program's workings by worlds is found."""
    assert faults == len(bench_faults(module, source))


def test_the_core_is_pure() -> None:
    """Decoding, timeline, estimators and monitor do no I/O, read no clock and are given their randomness."""
    assert [] == [
        fault
        for path in modules()
        if is_pure(dotted_name(path))
        for fault in purity_faults(dotted_name(path), read(path))
    ]


@functools.cache
def with_bench() -> tuple[Path, ...]:
    """Every module of program and benchmarks."""
    return tuple(sorted(path for root in (PACKAGE, BENCH) for path in root.rglob("*.py")))


def rings(needs: dict[str, set[str]]) -> list[str]:
    """Names that need themselves over others, what each needs given."""
    reached = {name: set(others) for name, others in needs.items()}
    for middle in needs:
        for others in reached.values():
            if middle in others:
                others |= reached[middle]
    return sorted(name for name, others in reached.items() if name in others)


def needs_of(paths: Sequence[Path]) -> dict[str, set[str]]:
    """What each module imports at its top, of the modules that are given; not for type checkers alone."""
    known = {dotted_name(path).removesuffix(".__init__") for path in paths}
    needs: dict[str, set[str]] = {}
    for path in paths:
        name = dotted_name(path).removesuffix(".__init__")
        top = [node for node in ast.parse(read(path)).body if isinstance(node, ast.Import | ast.ImportFrom)]
        found = {full for node in top for _, full in imported([node])}
        parents = {full.rpartition(".")[0] for full in found if full not in known}
        needs[name] = {target for target in (*found, *parents) if target in known and target != name}
    return needs


def test_imports_are_written_in_full() -> None:
    """No relative import in program, benchmarks and tests."""
    everywhere = [*with_bench(), *sorted(TESTS.rglob("*.py"))]
    written = re.compile(r"^\s*from\s*\.", re.MULTILINE)  # a source without it has no relative import
    found = {
        dotted_name(path): [name for _, name in imports(read(path))]
        for path in everywhere
        if written.search(read(path))
    }

    assert [] == [module for module, names in found.items() if any(name.startswith(".") for name in names)]


def test_no_modules_import_each_other_in_a_ring() -> None:
    """Nested packages included: program and benchmarks can be read from the bottom up."""
    assert [] == rings(needs_of(with_bench()))


def test_the_watch_over_rings_sees() -> None:
    """A ring of three is found with all its members; a diamond is none."""
    assert ["a", "b", "c"] == rings({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})
    assert [] == rings({"a": {"b", "c"}, "b": {"d"}, "c": {"d"}, "d": set()})


def branches(function: ast.AST) -> int:
    """Decisions of a function: if, for, while, except, and/or, comprehensions."""
    kinds = (ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.BoolOp, ast.comprehension)
    return sum(isinstance(node, kinds) for node in ast.walk(function))


def branchy(module: str, source: str) -> dict[str, int]:
    """Functions of a module with more than `MAX_BRANCHES` decisions; each takes a word of its own."""
    if len(re.findall(r"\b(?:if|elif|for|while|except|and|or)\b", source)) <= MAX_BRANCHES:
        return {}
    return {
        f"{module}.{node.name}": decisions
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (decisions := branches(node)) > MAX_BRANCHES
    }


def test_functions_decide_little() -> None:
    """A function has at most 15 branches, tests included."""
    found: dict[str, int] = {}
    for path in [*with_bench(), *TESTS.rglob("*.py")]:
        found |= branchy(dotted_name(path), read(path))

    assert {} == found


def test_the_watch_over_branches_sees() -> None:
    """Sixteen decisions are found, fifteen let through."""
    sources = ["def f(x):\n" + "    if x:\n        pass\n" * number for number in (15, 16)]

    assert [{}, {"m.f": 16}] == [branchy("m", source) for source in sources]


SHARED_CLASS_NAMES: dict[str, int] = {}
"""Public class names that two or more modules of the program define, with their number; only shrinks."""


def classes_of(sources: dict[str, str]) -> Counter[str]:
    """Return in how many of the modules each public class name is defined at the top."""
    return Counter(
        name
        for source in sources.values()
        for name in {node.name for node in ast.parse(source).body if isinstance(node, ast.ClassDef)}
        if not name.startswith("_")
    )


def test_a_class_name_has_one_meaning() -> None:
    """No public class name is defined in two modules but those of `SHARED_CLASS_NAMES`, which shrinks."""
    found = classes_of({dotted_name(path): read(path) for path in modules()})
    shared = {name: count for name, count in found.items() if count > 1}

    assert {} == {name: n for name, n in shared.items() if n > SHARED_CLASS_NAMES.get(name, 1)}
    assert {} == {name: n for name, n in SHARED_CLASS_NAMES.items() if n != found[name]}


def test_the_watch_over_class_names_sees() -> None:
    """A name in two modules counts twice; one of a function, or defined twice in a module, once."""
    sources = {"a": "class X: pass\nclass Y: pass", "b": "class X: pass\ndef f():\n    class Y: pass"}

    assert {"X": 2, "Y": 1} == classes_of(sources)


def test_modules_say_what_they_are_for() -> None:
    """Every module that holds anything begins with a docstring."""
    assert [] == [
        dotted_name(path)
        for path in with_bench()
        if read(path).strip() and not ast.get_docstring(ast.parse(read(path)))
    ]


TERMS_DONE = (
    "tpmsd/foundation",
    *(f"tpmsd/car/{package}" for package in ("config", "cars", "physics", "rings", "vehicle_state")),
    *(
        f"tpmsd/onboard/{package}"
        for package in ("daemon", "estimators", "monitor", "resonance", "sinks", "sources", "timeline")
    ),
    *(
        f"tpmsd/offline/{package}"
        for package in ("calibration", "discovery", "drive_checks", "drives", "fleet", "inference", "rings")
    ),
    *(f"tpmsd/offline/{package}" for package in ("dynamics", "planning", "signals", "simulator", "tables")),
    *("tpmsd/offline/diagnosis", "tpmsd/offline/report"),
    *("tpmsd/interfaces/bridges", "tpmsd/interfaces/cli"),
)
"""Packages whose docstrings and identifiers are in terms of the field; grows until it holds every package."""
_FRAGMENT = re.compile(r"(What|Whether|Of|Which|Why|How|As|By|Where|The same|An? `[^`]+` that is)\b")
"""Opening words of a docstring that is no sentence and no noun phrase."""
_NO_VERB = re.compile(
    r"(The|An?|All|One|Its?|Up|Back|For|Per|Columns|Cumulative|Derivative|Edges|Gain|Gram|Knots|Logarithm|Mean|Nats"
    r"|Names?|Numbers?|Penalty|Probability|Product|Root|Speed|Standard|Status|Sum|Truth|Wheels)\b"
)
"""Opening words of a function's docstring without a verb; a property has a noun phrase, as a field."""
TERMS: dict[str, str] = {
    **dict.fromkeys(("told", "tells", "telling"), "reported, stated, sent or cached"),
    "odd": "irregular or implausible",
    "even": "regular or uniform",
    "way": "distance_m",
    "ways": "distances_m",
    "wander": "drift",
    "place": "index, position or wheel pattern",
    "places": "indices, positions or wheel patterns",
    "fellow": "other wheel of the axle",
    "harmless": "nuisance",
    **dict.fromkeys(("take_up", "taken_up"), "restore"),
    **dict.fromkeys(("sure", "spare", "net", "worth"), "margin, gain or probability"),
    "anew": "again",
    "alike": "similar, common or shared",
    **dict.fromkeys(("hear", "hears", "heard"), "receive, received"),
    **dict.fromkeys(("rival", "rivals"), "alternative, competing or confounded with"),
    **dict.fromkeys(("price", "prices"), "penalty"),
    **dict.fromkeys(("witness", "witnesses"), "contrast, reference or independent evidence"),
    "beside": "jointly, next to",
    **dict.fromkeys(("believed", "believes"), "trusted, accepted or a fraction"),
    **dict.fromkeys(("account", "accounts"), "model or change hypothesis"),
    **dict.fromkeys(("sight", "sees", "blind"), "minimum detectable loss, can_detect"),
    **dict.fromkeys(("wing", "wings"), "layer"),
    "study": "regression",
    "twins": "confounded_with or similar",
    **dict.fromkeys(("stands", "standing"), "active (an alarm) or at_standstill (a car)"),
}
"""Words of identifiers, and the terms that stand for them."""
_TERMS_KEPT = {
    "tpmsd/car/physics/effects/spare_or_mixed_tyre.py": {"SpareOrMixedTyre"},  # a spare wheel
    "tpmsd/offline/rings/settings.py": {"even_count", "odd_count"},  # parity of a number of teeth
    "tpmsd/offline/report/mpl_style.py": {"place_labels"},  # to place, a verb
    "tpmsd/offline/planning/search.py": {"told"},  # a key of tpmsd.plan/1
    "tpmsd/car/physics/effect_records.py": {"Rivals", "Beside"},  # former names, for effects of users
}


@functools.cache
def docstring_fragments(name: str, source: str) -> list[str]:
    """Return the docstrings of a source, those under a name included, that open as fragments, a line each."""
    faults = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name != "__init__":
            text = ast.get_docstring(node) or ""
            is_property = any(ast.unparse(each).endswith("property") for each in node.decorator_list)
            if not is_property and (opening := _NO_VERB.match(text)):
                faults.append(
                    f"{name}:{node.lineno}: the docstring of {node.name} opens with {opening.group()!r}; "
                    "begin with a verb ('Return ...')"
                )
        if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            continue
        literal = node.value.value
        if isinstance(literal, str) and (opening := _FRAGMENT.match(literal.strip())):
            faults.append(
                f"{name}:{node.lineno}: the docstring opens with {opening.group()!r}; "
                "begin with a verb ('Return ...') or a noun phrase"
            )
    return sorted(faults)


def unclear_identifiers(name: str, source: str) -> list[str]:
    """Return the names that a module defines with a word of `TERMS`, a line each with the term."""
    defined: list[tuple[int, str]] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            defined.append((node.lineno, node.name))
        elif isinstance(node, ast.arg):
            defined.append((node.lineno, node.arg))
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            defined.append((node.lineno, node.id))
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            defined.append((node.lineno, node.attr))
    faults = []
    for line, identifier in sorted(set(defined)):
        words = "_" + re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", identifier).lower().strip("_") + "_"
        found = [word for word in TERMS if f"_{word}_" in words]
        if found and identifier not in _TERMS_KEPT.get(name, ()):
            faults.append(f"{name}:{line}: {identifier}; for {found[0]!r} the term is: {TERMS[found[0]]}")
    return faults


def test_docstrings_are_sentences() -> None:
    """No docstring of the program opens as a fragment."""
    faults = []
    for path in modules():
        faults += docstring_fragments(path.relative_to(REPO).as_posix(), read(path))

    assert [] == faults


def unfinished_first_lines(source: str) -> list[str]:
    """Return the functions whose docstring has a first line that states nothing: its statement goes on in the
    next line and has no part before a stop."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        first, *others = (ast.get_docstring(node) or "").split("\n\n")[0].splitlines() or [""]
        if others and not re.search(r",|[;.:] ", first):
            found.append(node.name)
    return found


def test_first_lines_state_the_result() -> None:
    """What a function does or returns is in the first line of its docstring; the next ones may add to it."""
    found = {path.relative_to(REPO).as_posix(): unfinished_first_lines(read(path)) for path in modules()}

    assert {} == {name: functions for name, functions in found.items() if functions}


def test_the_watch_over_first_lines_sees() -> None:
    """A statement that is cut in two is found; one that ends, or whose addition is cut, is let through."""
    cut = 'def f():\n    """Return the radius of each wheel that the\n    bus has."""'
    added = 'def f():\n    """Return the radii of the bus, m; NaN of the\n    others."""'

    assert ["f"] == unfinished_first_lines(cut)
    assert [] == unfinished_first_lines(added)


def test_finished_packages_are_in_terms_of_the_field() -> None:
    """No docstring of the packages of `TERMS_DONE` opens as a fragment, and no name has a word of `TERMS`."""
    faults = []
    for package in TERMS_DONE:
        for path in sorted((REPO / package).rglob("*.py")):
            name = path.relative_to(REPO).as_posix()
            faults += [*docstring_fragments(name, read(path)), *unclear_identifiers(name, read(path))]

    assert [] == faults


@pytest.mark.parametrize(
    ("source", "faults"),
    [
        ('"""What a module holds."""', 1),
        ('"""Return what it holds."""', 0),
        ('def f():\n    """Whether it holds."""', 1),
        ('class C:\n    """A record."""\n    x = 0.0\n    """Of the front axle."""', 1),
        ('class C:\n    def f(self):\n        self.x = 0\n        """The same again."""', 1),
        ('class C:\n    """An `x` that is y."""', 1),
        ('def f():\n    """The next frame."""', 1),
        ('class C:\n    @property\n    def f(self):\n        """The next frame."""', 0),
        ('x = 1\n"""Offset of the clocks, s."""', 0),
        ('print("What is printed is no docstring")', 0),
        ("told = 1", 1),
        ("def f(places): return places", 1),
        ("def f(): return x.place", 0),
        ("class OddFrame: pass", 1),
        ("self._hint_told_s = 1.0", 1),
        ("wayward = evening = network = 1", 0),
    ],
)
def test_the_watch_over_terms_sees(source: str, faults: int) -> None:
    """A fragment and a name with a word of `TERMS` are found; uses of others' names are let through."""
    assert faults == len(docstring_fragments("m.py", source) + unclear_identifiers("m.py", source))


_DOCSTRING = re.compile(r'(?ms)^[ ]*r?"""(.*?)"""')
_COMMENT = re.compile(r"(?m)(?<![\"'\w])#(.*)$")
_QUOTED = re.compile(r"`([^`\n]+)`")
_COMPOUND = re.compile(r"\b[A-Za-z0-9]+_\w+|\b_\w+")
"""A name of several words, or a private one: what is a single word may be a word of English."""
_DOTTED = re.compile(r"[a-z_]\w*(?:\.\w+)+")
_OF_OTHERS = {"car", "can", "error", "np", "numpy", "org", "scipy", "tomllib", "tpmsd"}
"""First parts of dotted names that are of other programs, or whose names test_documentation resolves."""
_EXAMPLES = {
    *("ID_0B0", "v_kmh", "wheel_angle_fl_rad", "wheel_speed_fl_kmh", "wheel_speed_fl_radps", "_rpm"),
    *("X_covariance", "accel_lat_times_speed", "car_2", "car_3", "front_drive", "test_NAME"),
    *("bus.can1.dbc", "ddmm.mmm", "sockaddr_un", "timeout_keep_alive", "_estimated"),
}
"""Names that are put together at run time, of a user's table or module, or of another program."""


@functools.cache
def prose(path: Path) -> str:
    """Return the docstrings and comments of a module; of a page all but its blocks of code."""
    if path.suffix == ".md":
        return re.sub(r"(?s)```.*?```", "", read(path))
    return "\n".join(_DOCSTRING.findall(read(path)) + _COMMENT.findall(read(path)))


@functools.cache
def words_of_code() -> tuple[frozenset[str], frozenset[str]]:
    """Return the words of all tracked code and of the files' names, and its pairs of words `one.other`;
    docstrings and comments are left out."""
    words: set[str] = set()
    pairs: set[str] = set()
    for path in tracked_files():
        parts = re.split(r"[/.]", path.relative_to(REPO).as_posix())
        words.update(parts)
        pairs.update(f"{one}.{other}" for one, other in itertools.pairwise(parts))
        if path.suffix in (".md", ".svg", ".png", ".gz", ".so") or path == Path(__file__).resolve():
            continue
        try:
            text = read(path)
        except UnicodeDecodeError:
            continue  # recordings and pictures
        if path.suffix == ".py":
            text = _COMMENT.sub("", _DOCSTRING.sub("", text))
            pairs.update(f"{path.stem}.{name}" for name in re.findall(r"\w+", text))
        words.update(re.findall(r"\w+", text))
        pairs.update(re.findall(r"(?=\b(\w+\.\w+))", text))
    return frozenset(words), frozenset(pairs)


def stale_names(text: str, dotted: bool = True) -> list[str]:
    """Return the names in backquotes that no code has: of several words, or `dotted`, `module.member`."""
    words, pairs = words_of_code()
    out = []
    for quoted in _QUOTED.findall(text):
        found = set(_COMPOUND.findall(quoted)) - _EXAMPLES
        out += sorted(name for name in found if name not in words)
        is_example = quoted in _EXAMPLES or quoted.split(".")[0] in _OF_OTHERS
        if dotted and _DOTTED.fullmatch(quoted) and not is_example:
            out += [pair for pair in re.findall(r"^\w+\.\w+", quoted) if pair not in pairs]
    return out


def test_names_that_docstrings_quote_exist() -> None:
    """A name in backquotes, in a docstring, a comment or a page on the code, is one that the code has."""
    pages = [REPO / "CONTRIBUTING.md", *sorted((REPO / "docs" / "explanation").glob("*.md"))]
    found = {
        # Pages name keys of JSON documents, which are dotted as well.
        path.relative_to(REPO).as_posix(): stale_names(prose(path), path.suffix == ".py")
        for path in (*with_bench(), *pages)
    }

    assert {} == {name: stale for name, stale in found.items() if stale}


def test_the_watch_over_quoted_names_sees() -> None:
    """A name that was renamed, and a module that has moved, are found; what exists is let through."""
    text = (
        "As `stale_of_old`, `timeline.old`, `timeline.plan`, `gates.path_length`, `path_length` and `a word`."
    )

    assert ["stale_of_old", "timeline.old"] == stale_names(text)


def test_the_architecture_names_every_package() -> None:
    """docs/explanation/architecture.md has a line for each package that exists."""
    text = read(REPO / "docs" / "explanation" / "architecture.md")
    packages = {package_of(dotted_name(path)) for path in modules()} - {"__init__"}

    assert [] == sorted(package for package in {*LAYERS, *packages} if f"`{package}`" not in text)


# The patterns are put together from pieces so that this file does not hold what it looks for.
_FORBIDDEN = {
    "a path of somebody's machine": r"/(?:work|tmp|root)" + r"/|/(?:home|Users)" + r"/\w",
    "a mark of unfinished work": r"\b(?:TO" + r"DO|FIX" + r"ME|XX" + r"X|HA" + r"CK)\b",
    "the address of a package index": r"index" + r"-url",
    "a trailer of a commit tool": r"(?i)co-authored" + r"-by",
}


def test_tracked_files_speak_of_the_project_alone() -> None:
    """No file names somebody's machine, holds marks of unfinished work or points to a package index."""
    found = []
    for path in tracked_files():
        try:
            text = read(path)
        except UnicodeDecodeError:
            continue  # recordings and pictures
        for what, pattern in _FORBIDDEN.items():
            for match in re.finditer(pattern, text):
                line = text.count("\n", 0, match.start()) + 1
                found.append(f"{path.relative_to(REPO)}:{line}: {what}: {match.group()}")
    assert [] == found


def test_only_terms_of_the_field_are_used() -> None:
    """No tracked text holds a wording of tests/language.py."""
    found = []
    for path in tracked_files():
        name = str(path.relative_to(REPO))
        if OTHERS.match(name):
            continue
        try:
            text = read(path)
        except UnicodeDecodeError:
            continue  # recordings and pictures
        found += [f"{name}:{line}: {words!r}; the term is: {term}" for line, words, term in found_in(text)]
    assert [] == found


def test_the_search_sees_wordings_over_line_breaks_and_in_any_case() -> None:
    """A wording is found whatever its case and wherever a line ends; a term of the field is let through."""
    text = "Gain of a term.\nA model of " + "Free" + "\nshape, and a spline term.\n"

    assert [2] == [line for line, _, _ in found_in(text)]


@pytest.mark.parametrize(
    ("module", "source", "faults"),
    [
        ("tpmsd.onboard.timeline.x", "from tpmsd.onboard.sources.events import Event", 0),
        ("tpmsd.onboard.timeline.x", "from tpmsd.onboard.monitor.records import AlarmEvent", 1),
        ("tpmsd.onboard.timeline.x", "import tpmsd.onboard.estimators.base", 1),
        ("tpmsd.onboard.timeline.x", "from tpmsd import Drive, __version__", 2),
        ("tpmsd.onboard.timeline.x", "from tpmsd.foundation import wheels", 0),
        ("tpmsd.onboard.timeline.x", "from tpmsd.onboard import sinks", 1),
        ("tpmsd.onboard.daemon.x", "from tpmsd.offline.report.page import Page", 1),
        ("tpmsd.offline.fleet.x", "from tpmsd.interfaces.api.functions import replay", 1),
        ("tpmsd.offline.fleet.x", "from tpmsd.onboard.monitor.records import AlarmEvent", 0),
        ("tpmsd.foundation.x", "from tpmsd.foundation.errors import ConfigError", 0),
        ("tpmsd.foundation.x", "from tpmsd.car.config.model import Config", 1),
        ("tpmsd.car.attic.x", "", 1),
        ("tpmsd.onboard.timeline.x", "def f():\n    from tpmsd.onboard.daemon import loop", 1),
        ("tpmsd.car.physics.x", "from tpmsd.car.config.model import VehicleConfig", 0),
        ("tpmsd.car.config.x", "from tpmsd.car.physics.model import Model", 1),
        ("tpmsd.offline.report.x", "from .wording import drive_time", 1),
        ("tpmsd.attic.x", "", 1),
    ],
)
def test_the_watch_over_imports_sees(module: str, source: str, faults: int) -> None:
    """A step against the flow is found, however the import is written; one along it is let through."""
    assert faults == len(direction_faults(module, source))


def test_generators_are_made_from_a_seed_in_one_place() -> None:
    """Only the pipeline makes a generator, and only from a seed."""
    seeded, unseeded = "rng = np.random.default_rng(seed)", "rng = np.random.default_rng()"

    assert [0, 1, 1] == [
        len(purity_faults("tpmsd.onboard.pipeline", seeded)),
        len(purity_faults("tpmsd.onboard.pipeline", unseeded)),
        len(purity_faults("tpmsd.onboard.estimators.x", seeded)),
    ]


@pytest.mark.parametrize(
    ("source", "faults"),
    [
        ("import math\nimport numpy as np\nfrom pathlib import Path", 0),
        ("def f(rng: np.random.Generator): return rng.normal()", 0),
        ("import time", 1),
        ("from os import path", 1),
        ("import numpy as np\nx = np.random.default_rng()", 1),
        ("from numpy.random import default_rng", 1),
        ("from datetime import datetime\nx = datetime.now()", 1),
        ("from datetime import datetime\nx = datetime(2024, 1, 1)", 0),
        ("x = open('state')", 1),
        ("def f(path):\n    return path.read_text()", 1),
    ],
)
def test_the_watch_over_purity_sees(source: str, faults: int) -> None:
    """Clocks, files and global randomness are found; arithmetic and a given generator are let through."""
    assert faults == len(purity_faults("tpmsd.onboard.estimators.x", source))
