"""`tpmsd fleet`: many drives of many cars, worked off in parallel and judged together.

In: a store and what to do with it. Out: tables, a report; progress on standard error.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.car.config.problems import escaped_lines
from tpmsd.foundation.english import counted
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.interfaces.cli.fleet_pages import write_drive_pages
from tpmsd.interfaces.cli.output import Subparsers, json_text
from tpmsd.interfaces.cli.output_files import Outputs

if TYPE_CHECKING:
    from tpmsd.offline.fleet.run import Tally
    from tpmsd.offline.fleet.store import Store

_DESCRIPTION = """\
Keeps the drives of a fleet in a store, replays, calibrates and diagnoses each on this machine's cores or on a
Dask cluster, and judges the drives of a car and the cars of a model together. Needs the extra tpmsd[fleet].
"""
_EPILOG = """\
examples:
  tpmsd fleet add store vans/*/*              folders, globs, URLs; the folder above a drive names its car
  tpmsd fleet run store --jobs 4              killed at any moment, it goes on with what is missing
  tpmsd fleet run store --scheduler tls://10.0.0.1:8786
  tpmsd fleet status store --json
  tpmsd fleet report store --html fleet.html
  tpmsd fleet sql store "select car, count(*) from alarms where kind = 'deflation' group by car"
"""
_SQL_EPILOG = """\
examples:
  tpmsd fleet sql store "select car, path, start, verdict from drives order by start"
  tpmsd fleet sql store "select car, wheel, reason from alarms where state = 'raised'" --csv alarms.csv
  tpmsd fleet sql store "select car, wheel, avg(deviation_mm) from wheels group by all" --parquet r.parquet
  tpmsd fleet sql store "describe findings"

On the screen times are UTC and keys are cut to ten letters; files hold seconds since 1970 and whole keys.
"""
_SIZE = re.compile(r"\d+(\.\d+)?\s*([kMGT]i?)?B?")
STAGES = ("replay", "calibrate", "diagnose")


def add_parser(subparsers: Subparsers) -> None:
    """Add `fleet` to the command line."""
    parser = subparsers.add_parser(
        "fleet",
        help="many drives of many cars",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parts = parser.add_subparsers(title="what to do", metavar="ACTION", dest="action", required=True)
    add = parts.add_parser("add", help="add drives; a drive that is there already is left alone")
    add.add_argument("store", type=Path, metavar="STORE", help="folder of the fleet; made if need be")
    add.add_argument("drives", nargs="+", metavar="DRIVE", help="drive folder, folder of drives, glob or URL")
    add.add_argument("--car", metavar="NAME", help="car of these drives (default: the folder above each)")
    add.add_argument("--model", metavar="NAME", help="model of the car (default: by its table [vehicle])")
    _add_optional_json(add)
    work = parts.add_parser("run", help="work on what is missing")
    work.add_argument("store", type=Path, metavar="STORE")
    where = work.add_mutually_exclusive_group()
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="a Dask scheduler that is trusted, as it can run code as you; such as tls://10.0.0.1:8786",
    )
    where.add_argument("--jobs", type=int, metavar="N", default=1, help="processes here (default: 1)")
    work.add_argument("--memory", metavar="SIZE", default="2GiB", help="of each process here (default: 2GiB)")
    work.add_argument(
        "--without", choices=("calibrate", "diagnose"), action="append", default=[], help="leave this out"
    )
    work.add_argument(
        "--recompute", action="store_true", help="again where another version of the program worked"
    )
    _add_optional_json(work)
    status = parts.add_parser("status", help="how far the store is")
    status.add_argument("store", type=Path, metavar="STORE")
    _add_optional_json(status)
    report = parts.add_parser("report", help="what the fleet shows, for its manager and its engineer")
    report.add_argument("store", type=Path, metavar="STORE")
    report.add_argument("--html", type=Path, metavar="FILE", help="write a page that opens offline")
    report.add_argument(
        "--drive-pages",
        action="store_true",
        help="with --html: also the page of every drive with an alarm, in FILE-drives, linked",
    )
    _add_optional_json(report)
    sql = parts.add_parser(
        "sql",
        help="ask the tables: drives wheels alarms findings statistics",
        description="Asks the store's tables in the SQL of DuckDB; 'describe drives' shows columns.",
        epilog=_SQL_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sql.add_argument("store", type=Path, metavar="STORE")
    sql.add_argument("query", metavar="QUERY")
    sql.set_defaults(free_text=("query",))
    sql.add_argument("--csv", metavar="FILE", help="write it as CSV to FILE ('-': standard output)")
    sql.add_argument("--parquet", metavar="FILE", type=Path, help="write it as Parquet to FILE")
    _add_optional_json(sql)


def _add_optional_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--json",
        metavar="FILE",
        nargs="?",
        const="-",
        help="write it as JSON to FILE (default and '-': standard output)",
    )


def run(args: argparse.Namespace) -> int:
    """Run the action of `tpmsd fleet`; return the exit code."""
    actions = {
        "add": _run_add,
        "run": _run_jobs,
        "status": _run_status,
        "report": _run_report,
        "sql": _run_sql,
    }
    return actions[args.action](args)


def _run_add(args: argparse.Namespace) -> int:
    from tpmsd.offline.fleet.find_drives import find_drives
    from tpmsd.offline.fleet.store import Store

    outputs = Outputs(("--json", args.json))
    store = Store.create(args.store) if args.store.exists() else None
    added = known = 0
    unusable: list[str] = []
    for name in args.drives:
        try:
            for entry in find_drives([name], args.car, args.model):
                if store is None:
                    store = Store.create(args.store)  # with the first drive: what is misspelt makes none
                if store.add(entry):
                    added += 1
                else:
                    known += 1
        except InputError as error:
            unusable.append(str(error))
    for line in unusable:
        print(escaped_lines(f"tpmsd: {line}"), file=sys.stderr)
    document = {
        **_document_head("tpmsd.fleet.add/1", args.store),
        "added": added,
        "known": known,
        "unusable": unusable,
    }
    if not outputs.fill_stdout:
        held = 0 if store is None else len(store.entries())
        print(f"{added} drives added, {known} were there already; the store has {held}")
    outputs.write({"--json": lambda: json_text(document)})
    return InputError.exit_code if unusable and not added + known else 0


def _scheduler_warning(scheduler: str) -> str:
    """Return one line on who can run code through a run on a cluster."""
    who = (
        "whoever holds a key of the cluster"
        if scheduler.startswith("tls://")
        else "without TLS whoever reaches it"
    )
    return f"--scheduler {scheduler} is trusted: {who} can run code as you, here and on its workers"


def _run_jobs(args: argparse.Namespace) -> int:
    from tpmsd.offline.fleet import run as fleet_run
    from tpmsd.offline.fleet.status import status_document
    from tpmsd.offline.fleet.store import Store
    from tpmsd.offline.fleet.tables import write_tables

    outputs = Outputs(("--json", args.json))
    if not 1 <= args.jobs <= 1024:
        raise ConfigError(f"--jobs {args.jobs}: 1 to 1024")
    if not _SIZE.fullmatch(args.memory):
        raise ConfigError(f"--memory {args.memory}: a size such as 2GiB or 500MB is wanted")
    store = Store.open(args.store)
    stages = tuple(stage for stage in STAGES if stage not in args.without)
    if args.scheduler is not None:
        print(f"tpmsd: {_scheduler_warning(args.scheduler)}", file=sys.stderr)
    shown = _ProgressDisplay()
    tally = fleet_run.run(store, args.scheduler, args.jobs, args.memory, stages, args.recompute, shown.update)
    shown.close()
    rows = write_tables(store)
    _print_damaged(store)
    document = {
        **_document_head("tpmsd.fleet.run/1", args.store),
        "worked_on": tally.done,
        "outcomes": tally.outcomes,
        "elapsed_s": tally.elapsed_s,
        "tables": rows,
        **status_document(store),
    }
    if not outputs.fill_stdout:
        outcomes = ", ".join(f"{count} {name}" for name, count in sorted(tally.outcomes.items()))
        print(f"{tally.done} drives worked on in {tally.elapsed_s:.0f} s{': ' if outcomes else ''}{outcomes}")
        print(escaped_lines(_status_text(document)))
    outputs.write({"--json": lambda: json_text(document)})
    return 0


def _run_status(args: argparse.Namespace) -> int:
    from tpmsd.offline.fleet.status import status_document
    from tpmsd.offline.fleet.store import Store

    outputs = Outputs(("--json", args.json))
    store = Store.open(args.store)
    document = {**_document_head("tpmsd.fleet.status/1", args.store), **status_document(store)}
    _print_damaged(store)
    if not outputs.fill_stdout:
        print(escaped_lines(_status_text(document)))
    outputs.write({"--json": lambda: json_text(document)})
    return 0


def _run_report(args: argparse.Namespace) -> int:
    from tpmsd.offline.fleet.report import report_document, report_text
    from tpmsd.offline.fleet.report_page import report_page
    from tpmsd.offline.fleet.store import Store
    from tpmsd.offline.fleet.tables import rows_of, rows_of_files
    from tpmsd.offline.report.page import check_report_packages

    outputs = Outputs(("--html", args.html), ("--json", args.json))
    if args.drive_pages and args.html is None:
        raise ConfigError("--drive-pages goes with --html FILE")
    if args.html is not None:
        check_report_packages()
    store = Store.open(args.store)
    tables = rows_of_files(store) or rows_of(store)
    _print_damaged(store)
    document = {**_document_head("tpmsd.fleet.report/1", args.store), **report_document(tables)}
    if not outputs.fill_stdout:
        outputs.say(escaped_lines(report_text(document)))
    pages = write_drive_pages(args.html, tables) if args.drive_pages else {}
    outputs.write(
        {"--html": lambda: report_page(document, tables, pages), "--json": lambda: json_text(document)}
    )
    if args.html is not None:
        of_drives = f" and {counted(len(pages), 'page')} of drives" if pages else ""
        print(
            f"tpmsd: wrote {args.html}{of_drives}; open it with a browser: {args.html.resolve().as_uri()}",
            file=sys.stderr,
        )
    return 0


def _run_sql(args: argparse.Namespace) -> int:
    from tpmsd.offline.fleet.sql_query import as_csv, as_parquet, as_text, ask
    from tpmsd.offline.fleet.store import Store

    outputs = Outputs(("--json", args.json), ("--csv", args.csv), ("--parquet", args.parquet))
    if str(args.parquet) == "-":
        raise ConfigError("--parquet -: the name of a file is wanted")
    names, rows = ask(Store.open(args.store), args.query)
    if not outputs.fill_stdout:
        print(as_text(names, rows))
    made = [dict(zip(names, row, strict=True)) for row in rows]
    outputs.write(
        {
            "--json": lambda: json_text({**_document_head("tpmsd.fleet.sql/1", args.store), "rows": made}),
            "--csv": lambda: as_csv(names, rows),
            "--parquet": lambda: as_parquet(names, rows),
        }
    )
    return 0


def _print_damaged(store: Store) -> None:
    """Print a line for each file that was left out, of twenty at most."""
    lines = [line for file, line in sorted(store.damaged.items()) if file.exists()]
    for line in lines[:20]:
        print(escaped_lines(f"tpmsd: {line}"), file=sys.stderr)
    if len(lines) > 20:
        print(f"tpmsd: and {len(lines) - 20} more damaged files", file=sys.stderr)


def _document_head(schema: str, store: Path) -> dict[str, Any]:
    """Return the keys `schema`, `program` and `input`; a store's hash would take as long as reading all of
    it.
    """
    from tpmsd.foundation.provenance import provenance

    head = provenance(schema)
    head["input"] = {"paths": [str(store)], "configuration": None, "configuration_hash": None, "hash": None}
    return {**head, "store": str(store)}


def _status_text(status: dict[str, Any]) -> str:
    lines = [
        f"{counted(status['drives'], 'drive')} of {counted(status['cars'], 'car')} "
        f"and {counted(status['models'], 'model')}: "
        f"{status['done']} done, {status['failed']} failed, {status['set_aside']} set aside, "
        f"{status['missing']} missing"
    ]
    if status["other_version"]:
        lines.append(f"{status['other_version']} by another version of the program (run --recompute)")
    lines += [f"  {one['path']}: {one['reason']}" for one in status["not_done"][:20]]
    if len(status["not_done"]) > 20:
        lines.append(f"  and {len(status['not_done']) - 20} more")
    return "\n".join(lines)


class _ProgressDisplay:
    """Progress with rate and time left: on a terminal one line, elsewhere a line now and then."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._next_s = 0.0
        self._width = 0

    def update(self, tally: Tally) -> None:
        """Show the drives done, the rate and the time left, unless shown recently."""
        from tpmsd.offline.fleet.settings import SETTINGS

        now = time.monotonic()
        if now < self._next_s and tally.done < tally.total:
            return
        self._next_s = now + (0.2 if self._terminal else SETTINGS.progress_s)
        minutes, seconds = divmod(round(min(tally.left_s, 359_999.0)), 60)
        left = f"{minutes // 60}:{minutes % 60:02d}:{seconds:02d}"
        line = f"{tally.done} of {tally.total} drives, {tally.rate:.2f} drives/s, {left} left"
        if self._terminal:
            print("\r" + line.ljust(self._width), end="", file=sys.stderr, flush=True)
            self._width = len(line)
        else:
            print(f"tpmsd: {line}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the line of progress."""
        if self._terminal and self._width:
            print(file=sys.stderr)
