"""Results of the functions: records that equal the commands' JSON, and show themselves.

In: the results of replay, diagnosis and calibration. Out: `Replay`, `Diagnosis`, `Calibration` with
`to_dict()` (the JSON of the command), `to_pandas()`, `plot()` and a table for notebooks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.model_file import save_model
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.palette import STYLES, line_style
from tpmsd.foundation.plain import plain, with_unit
from tpmsd.foundation.provenance import provenance
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.api.axes import given_or_new_axes
from tpmsd.offline.report.card import card, one_line
from tpmsd.offline.report.replay_document import REPLAY_SCHEMA, replay_document
from tpmsd.offline.report.replay_result import ReplayResult, WheelOutcome
from tpmsd.offline.report.replay_series import settled_range
from tpmsd.offline.report.wording import alarm_label
from tpmsd.offline.tables.extras import import_pandas
from tpmsd.offline.tables.tick_table import TickTable
from tpmsd.onboard.monitor.records import AlarmEvent

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from tpmsd.offline.calibration.result import FittedGeometry
    from tpmsd.offline.diagnosis.assessment.result import Finding, RollingDiagnosis


DIAGNOSIS_SCHEMA = "tpmsd.diagnosis/2"
CALIBRATION_SCHEMA = "tpmsd.calibration/2"


@dataclass(frozen=True)
class Source:
    """Inputs of a result: folders and configuration; nothing of drives in memory."""

    folders: tuple[Path, ...] = ()
    configuration: Path | None = None

    def document(self, schema: str) -> dict[str, Any]:
        """Return the keys `schema`, `program` and `input` of a document; reads the files once more to hash
        them."""
        return provenance(schema, self.folders, self.configuration)


@dataclass(frozen=True)
class Replay:
    """Replay of a drive, as the daemon would have judged it."""

    result: ReplayResult
    """The record that reports and plots are made of."""
    table: TickTable | None
    """A row per tick; None where it was not asked for."""
    notes: tuple[str, ...] = ()
    """Notes on what was wrong with the recording, a line each."""
    source: Source = Source()

    @property
    def alarms(self) -> tuple[AlarmEvent, ...]:
        """Return the alarms raised and cleared, in order."""
        return self.result.alarms

    @property
    def wheels(self) -> dict[str, WheelOutcome]:
        """Return each wheel that was on the bus, at the end of the drive."""
        return {one.wheel: one for one in self.result.wheels if one.seen_s > 0}

    def __repr__(self) -> str:
        """Drive, length and what is raised at its end."""
        result = self.result
        raised = [f"{a.kind} {a.wheel or ''}".strip() for a in self.alarms if a.state == "raised"]
        minutes = result.duration_s / 60.0
        alarms = f"raised: {', '.join(raised)}" if raised else "no alarms"
        return one_line("Replay", repr(result.drive), f"{minutes:.1f} min", alarms)

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `tpmsd replay --json`."""
        return _plain_document({**self.source.document(REPLAY_SCHEMA), **replay_document(self.result)})

    def to_pandas(self) -> pd.DataFrame:
        """Return the tick table; ConfigError where it was not asked for, or without pandas."""
        if self.table is None:
            raise ConfigError("the ticks were not kept: replay(drive, table=True)")
        return self.table.to_pandas()

    def to_html(self) -> str:
        """Return the page of `tpmsd replay --html`; ConfigError without the extra `report`."""
        from tpmsd.interfaces.api.pages import replay_html
        from tpmsd.offline.report.page import Origin, check_report_packages

        check_report_packages()
        return replay_html(
            self.result, self.table, Origin.now(self.source.document(REPLAY_SCHEMA)), self.notes
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw each radius minus nominal with a band of two standard deviations, and the alarms; return the
        axes."""
        axes = given_or_new_axes(ax)
        from tpmsd.offline.report.mpl_style import place_labels

        result = self.result
        minutes = (result.time_s - result.start_s) / 60.0
        for k, wheel in enumerate(WHEELS):
            middle, band = 1e3 * result.deviation_m[:, k], 2e3 * result.std_m[:, k]
            if not any(math.isfinite(value) for value in middle.tolist()):
                continue
            (line,) = axes.plot(minutes, middle, label=wheel, **line_style(wheel))
            axes.fill_between(minutes, middle - band, middle + band, color=line.get_color(), alpha=0.2, lw=0)
        axes.set(xlabel="time (min)", ylabel="radius minus nominal (mm)", title=result.drive)
        axes.set_ylim(*settled_range(1e3 * result.deviation_m, 1e3 * result.std_m, [0.0]))
        axes.legend(ncols=4, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.12))
        moments = []
        for alarm in result.alarms:
            raised = alarm.state == "raised"
            name = f"{alarm_label(alarm)}{'' if raised else ' cleared'}"
            moments.append(((alarm.time_s - result.start_s) / 60.0, name, "bad" if raised else "soft"))
        place_labels(axes, moments)
        return axes

    def _repr_html_(self) -> str:
        """Return the wheels and alarms as a card for a notebook."""
        document = self.to_dict()
        wheels = [
            (
                name,
                _mm_text(one["deviation_mm"], one["std_mm"]),
                _mm_text(one["change_mm"], one["change_std_mm"]),
                one["state"],
            )
            for name, one in document["wheels"].items()
        ]
        alarms = [
            (f"{one['drive_time_s']:.0f} s", one["kind"], one["wheel"] or "", one["state"], one["reason"])
            for one in document["alarms"]
        ]
        head = f"{document['drive']}: {(document['duration_s'] or 0.0) / 60:.1f} min"
        return card(
            head,
            (("wheel", "minus nominal (mm)", "change (mm)", "state"), wheels),
            (("time", "alarm", "wheel", "state", "reason"), alarms),
        )


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis: physics that drives hold and the rolling model leaves out."""

    result: RollingDiagnosis
    """The record that reports and plots are made of."""
    drives: tuple[str, ...]
    source: Source = Source()

    @property
    def verdict(self) -> str:
        """Return consistent, mismatch or insufficient_data."""
        return self.result.verdict

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Return findings and suspicions, the strongest first."""
        return self.result.findings

    @property
    def model(self) -> ExtendedModel:
        """Return the rolling model with what was found; `replay` and `simulate` take it."""
        return self.result.model

    def save_model(self, path: str | Path) -> Path:
        """Write the extended model as a model.toml that the commands take with --model."""
        save_model(Path(path), self.model, f"written by tpmsd.diagnose from {', '.join(self.drives)}")
        return Path(path)

    def __repr__(self) -> str:
        """Drives, verdict and findings."""
        found = [f"{one.effect} ({one.confidence:.2f})" for one in self.findings]
        return one_line("Diagnosis", repr(", ".join(self.drives)), self.verdict, *found)

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `tpmsd diagnose --json`."""
        from tpmsd.offline.report.diagnosis_document import diagnosis_document

        return _plain_document(
            {**self.source.document(DIAGNOSIS_SCHEMA), **diagnosis_document(self.result, None)}
        )

    def to_pandas(self) -> pd.DataFrame:
        """Return a row per parameter of each finding (one row for a finding without parameters)."""
        rows = []
        for finding in self.to_dict()["findings"]:
            shared = {
                "effect": finding["effect"],
                "confidence": finding["confidence"],
                "wheels": " ".join(finding["where"]["wheels"]),
                "channel": finding["where"]["channel"],
                "covariate": finding["where"]["covariate"],
                "gain_nats": finding["heldout"].get("loglik_gain"),
            }
            none = {"": {"value": None, "std": None, "unit": ""}}
            for name, quantity in (finding["parameters"] or none).items():
                rows.append({**shared, "parameter": name, **quantity})
        columns = ["effect", "parameter", "value", "std", "unit", "confidence"]
        columns += ["wheels", "channel", "covariate", "gain_nats"]
        frame: pd.DataFrame = import_pandas().DataFrame(rows, columns=columns)
        return frame

    def to_html(self, standalone: bool = True) -> str:
        """Return the page of `tpmsd diagnose --html`; ConfigError without the extra `report`.

        `standalone`: with its styles and scripts in it; else it links to `assets/` beside it.
        """
        from tpmsd.offline.report.diagnosis_page import diagnosis_page
        from tpmsd.offline.report.page import Origin, check_report_packages

        check_report_packages()
        origin = Origin.now(self.source.document(DIAGNOSIS_SCHEMA))
        return diagnosis_page(self.result, self.drives, origin, standalone=standalone)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the held-out log-likelihood gain of each finding on a logarithmic axis; suspicions are
        hatched.

        Where nothing was found a sentence says so.
        """
        axes = given_or_new_axes(ax)
        if not self.findings:
            from tpmsd.offline.report.simulation_text import agreement

            text = self.result.reason if self.result.reason else agreement(self.result)
            axes.text(0.5, 0.5, text, ha="center", va="center", wrap=True, transform=axes.transAxes)
            axes.set(xticks=[], yticks=[], title=f"{', '.join(self.drives)}: {self.verdict}")
            axes.set_frame_on(False)
            return axes
        found = self.findings[::-1]
        gains = [finding.gain for finding in found]
        bars = axes.barh(range(len(found)), gains, color=STYLES["after"].colour)
        for bar, finding in zip(bars, found, strict=True):
            if finding.status == "suspicion":
                bar.set(facecolor="none", edgecolor=STYLES["after"].colour, hatch="//")
        axes.bar_label(bars, [f"{gain:.3g}" for gain in gains], padding=3)
        axes.set_yticks(range(len(found)), [finding.effect for finding in found])
        if gains:
            axes.set_xscale("symlog")
            axes.set_xlim(min(0.0, *gains), 10.0 * max(1.0, *gains))
        axes.set(
            xlabel="held-out log-likelihood gain (nats)", title=f"{', '.join(self.drives)}: {self.verdict}"
        )
        return axes

    def _repr_html_(self) -> str:
        """Return the findings as a card for a notebook."""
        rows = []
        for finding in self.to_dict()["findings"]:
            values = ", ".join(
                f"{name} = {_quantity_text(one)}" for name, one in finding["parameters"].items()
            )
            rows.append((finding["effect"], values, f"{finding['confidence']:.2f}"))
        reason = f" ({self.result.reason})" if self.result.reason else ""
        head = f"{', '.join(self.drives)}: {self.verdict}{reason}"
        return card(head, (("effect", "parameters", "confidence"), rows))


@dataclass(frozen=True)
class Calibration:
    """Radii and tracks of a car by its drives."""

    result: FittedGeometry
    """The record that reports and plots are made of."""
    source: Source = Source()
    nominal_m: Mapping[str, float] = field(default_factory=dict)
    """Configured radius of each wheel, metres."""
    bus_radii_m: Mapping[str, float] = field(default_factory=dict)
    """Radius by which each speed on the bus was made rotation, metres; the radii hold with these."""

    @property
    def radii_m(self) -> dict[str, float]:
        """Return the radius of each wheel that was read."""
        return {wheel: one.radius_m for wheel, one in self.result.wheels.items()}

    def __repr__(self) -> str:
        """Drives and radii."""
        drives, wheels = ", ".join(self.result.drives), self.result.wheels
        radii = [
            f"{w} {1e3 * one.radius_m:.2f} +- {1e3 * one.radius_std_m:.2f} mm" for w, one in wheels.items()
        ]
        return one_line("Calibration", repr(drives), *radii)

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `tpmsd calibrate --json`."""
        from tpmsd.offline.calibration.wording import document as calibration_document

        found = calibration_document(self.result, self.bus_radii_m)
        return _plain_document({**self.source.document(CALIBRATION_SCHEMA), **found})

    def to_pandas(self) -> pd.DataFrame:
        """Return a row per wheel."""
        rows = [{"wheel": wheel, **values} for wheel, values in self.to_dict()["wheels"].items()]
        frame: pd.DataFrame = import_pandas().DataFrame(rows)
        return frame

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw each wheel's radius with two standard deviations over its configured one; return the axes."""
        axes = given_or_new_axes(ax)
        wheels = self.result.wheels
        values = [1e3 * one.radius_m for one in wheels.values()]
        bands = [2e3 * one.radius_std_m for one in wheels.values()]
        axes.errorbar(
            range(len(wheels)), values, yerr=bands, fmt="o", capsize=4, color=STYLES["after"].colour
        )
        for k, wheel in enumerate(wheels):
            if wheel in self.nominal_m:
                label = "" if axes.get_legend_handles_labels()[1] else "configured"
                nominal_mm = 1e3 * self.nominal_m[wheel]
                axes.hlines(nominal_mm, k - 0.4, k + 0.4, color=STYLES["soft"].colour, ls="--", label=label)
        if axes.get_legend_handles_labels()[1]:
            axes.legend(frameon=False)
        axes.set_xticks(range(len(wheels)), list(wheels))
        axes.set(ylabel="radius (mm), two standard deviations", title=", ".join(self.result.drives))
        return axes

    def _repr_html_(self) -> str:
        """Return the radii as a card for a notebook."""
        rows = [
            (wheel, f"{1e3 * one.radius_m:.2f} ± {1e3 * one.radius_std_m:.2f}")
            for wheel, one in self.result.wheels.items()
        ]
        return card(f"Calibration from {', '.join(self.result.drives)}", (("wheel", "radius (mm)"), rows))


def _plain_document(document: dict[str, Any]) -> dict[str, Any]:
    made: dict[str, Any] = plain(document)
    return made


def _mm_text(value: float | None, std: float | None) -> str:
    if value is None:
        return ""
    return f"{value:+.2f}" if std is None else f"{value:+.2f} ± {std:.2f}"


def _quantity_text(quantity: dict[str, Any]) -> str:
    value, std = quantity["value"], quantity["std"]
    if not isinstance(value, int | float):
        return str(value)
    number = f"{value:.4g}" + ("" if std is None else f" ± {std:.2g}")
    return with_unit(number, quantity["unit"])
