"""HTML pages from one set of Jinja2 templates: reports that stand alone, and the same pages of `tpmsd web`.

In: a template's name and what it shows: tiles, tables, figures, where it all comes from. Out: HTML. A page
that stands alone holds its styles, scripts and pictures itself and loads nothing. Jinja2 and matplotlib are
the optional extra `tpmsd[report]`.
"""

from __future__ import annotations

import datetime
import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.report.figures import Figure

ASSETS = Path(__file__).parent / "assets"
"""Styles and scripts: inlined into reports, served by `tpmsd web`."""
_TEMPLATES = Path(__file__).parent / "templates"
_STYLES = ("uPlot.min.css", "theme.css", "report.css")
_SCRIPTS = ("uPlot.iife.min.js", "report.js")


@dataclass(frozen=True)
class Tile:
    """One number of a page's head, with what it means."""

    value: str
    name: str
    help: str


@dataclass(frozen=True)
class Cell:
    """One cell of a table."""

    text: str
    sort: float | None = None
    """Key by which the column is sorted; the text where it is None."""
    number: bool = False
    """Aligned to the right."""
    link: str = ""
    """Identifier on the same page."""
    href: str = ""
    """Another page, relative to this one."""
    style: str = ""
    """A class of the style sheet."""


@dataclass(frozen=True)
class HtmlTable:
    """Rows under heads; a click on a head sorts where JavaScript runs."""

    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    @property
    def numbers(self) -> tuple[bool, ...]:
        """Return True for each column that holds numbers."""
        return tuple(any(row[k].number for row in self.rows) for k in range(len(self.heads)))


@dataclass(frozen=True)
class RenderedFigure:
    """A figure as a picture and as data."""

    key: str
    title: str
    help: str
    svg: str
    """Empty where only the interactive figure is wanted."""
    data: str
    """JSON for the script; empty where the picture is all there is."""


@dataclass(frozen=True)
class Origin:
    """Origin of a page: inputs, time, program."""

    made_at: datetime.datetime
    """Aware."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """The keys `program` and `input` of the JSON document."""

    @classmethod
    def now(cls, provenance: Mapping[str, Any]) -> Origin:
        """Return the origin of a page that is made now."""
        return cls(datetime.datetime.now(datetime.UTC), provenance)

    @property
    def entries(self) -> tuple[tuple[str, str], ...]:
        """Return the (name, value) pairs in the foot of a page."""
        program = self.provenance.get("program") or {}
        read = self.provenance.get("input") or {}
        version = f"{program.get('name', 'tpmsd')} {program.get('version', '')}".strip()
        if program.get("commit"):
            version += f" ({str(program['commit'])[:12]})"
        if program.get("kernel"):
            version += f", kernel: {program['kernel']}"
        entries = [
            ("Made", self.made_at.astimezone(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")),
            ("Program", version),
            ("Input", ", ".join(map(str, read.get("paths") or ())) or "data in memory"),
            ("Configuration", str(read.get("configuration") or "none")),
            ("Configuration hash", str(read.get("configuration_hash") or "none")),
            ("Input and configuration hash", str(read.get("hash") or "none")),
        ]
        return tuple(entries)


def check_report_packages() -> None:
    """Raise ConfigError if a package of the extra is missing: before the work, not after it."""
    for package in ("jinja2", "matplotlib"):
        if importlib.util.find_spec(package) is None:
            raise ConfigError(
                f"HTML reports need {package}, which is not installed: pip install 'tpmsd[report]'"
            )


def render_figure(figure: Figure, key: str, help: str = "", static: bool = True) -> RenderedFigure:  # noqa: A002
    """Return a figure for a page; `key` is unique on it. `static`: with a picture for readers without
    JavaScript.
    """
    from tpmsd.offline.report.figure_data import figure_json
    from tpmsd.offline.report.static_figures import draw_static  # needs matplotlib

    picture = draw_static(figure, key) if static else None
    svg = "" if picture is None else picture.svg
    return RenderedFigure(key, figure.title, help, svg, figure_json(figure, picture))


def render(template: str, origin: Origin, standalone: bool, **content: object) -> str:
    """Return a template's HTML. `standalone`: with styles and scripts in it; else linked as `assets/...`."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    inlined = {
        "styles": [_asset_text(name) for name in _STYLES] if standalone else [],
        "scripts": [_asset_text(name) for name in _SCRIPTS] if standalone else [],
    }
    linked = {"style_files": _STYLES, "script_files": _SCRIPTS}
    return environment.get_template(template).render(
        standalone=standalone, origin=origin, **inlined, **linked, **content
    )


def _asset_text(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")
