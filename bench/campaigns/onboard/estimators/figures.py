"""The figures, as PNG.

In: the bench's result as plain numbers. Out: files. Needs matplotlib (the extra `plot`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, NullLocator, ScalarFormatter

from bench.campaigns.onboard.estimators.methods import POSITIONS, SAMPLED, WANTED
from bench.campaigns.onboard.estimators.summary import diverged, fig9, interval, mean, pick
from bench.campaigns.onboard.estimators.tasks import NUMBERS, RECEIVERS, SERIES_EVERY, USUAL
from bench.worlds.paper_drive import SCENARIOS, TICK_S
from bench.worlds.paper_route import paper_route

Row = dict[str, Any]
COLOURS = dict(
    zip(
        WANTED,
        ("tab:red", "tab:blue", "black", "tab:green", "tab:olive", "tab:purple", "tab:cyan"),
        strict=True,
    )
)
MARKERS = dict(zip(WANTED, "*os^vDP", strict=True))


def _save(figure: Figure, out: Path, name: str) -> Path:
    if figure.get_layout_engine() is None:
        figure.tight_layout()
    path = out / name
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def _legend(axes: Axes, **where: Any) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, **where)


def _legend_below(figure: Figure, axes: Iterable[Axes]) -> None:
    """One legend for all, where it hides nothing; methods in the order of the tables, each once."""
    found: dict[str, Any] = {}
    for each in axes:
        handles, labels = each.get_legend_handles_labels()
        found = dict(zip(labels, handles, strict=True)) | found
    names = sorted(found, key=lambda name: WANTED.index(name) if name in WANTED else len(WANTED))
    if names:
        figure.legend([found[name] for name in names], names, loc="outside lower center", ncols=8, fontsize=8)


def _plain_log(axes: Axes) -> None:
    """1, 2, 5 as numbers beside a logarithmic axis."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())


def draw_route(_: dict[str, Any], out: Path) -> Path:
    """The drive, as Fig 3, and its speed."""
    route = paper_route()
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.5))
    left.plot(route.east_m / 1e3, route.north_m / 1e3, color="black")
    left.plot(route.east_m[0] / 1e3, route.north_m[0] / 1e3, "go", label="start")
    left.set(xlabel="east, km", ylabel="north, km", title="The drive: 12 km", aspect="equal")
    _legend(left)
    right.plot(route.time_s[::10] / 60, route.speed_mps[::10], color="black")
    right.set(xlabel="time, min", ylabel="speed, m/s", title="18 min")
    return _save(figure, out, "route.png")


def draw_fig8(result: dict[str, Any], out: Path) -> Path | None:
    """mu3 - mu4 over time, scenario by receiver (Figs 5, 7 and 8)."""
    return _over_time(result, out, "fig8-difference.png", error=False)


def draw_error(result: dict[str, Any], out: Path) -> Path | None:
    """The same less the truth: on the ramps only the errors tell the methods apart."""
    return _over_time(result, out, "error-over-time.png", error=True)


def _over_time(result: dict[str, Any], out: Path, file: str, error: bool) -> Path | None:
    rows = [row for row in result.get("rows", []) if "series" in row and not row["front"]]
    if not rows:
        return None
    names = [n for n in SCENARIOS if pick(rows, scenario=n)]
    figure, axes = plt.subplots(
        len(names),
        len(RECEIVERS),
        figsize=(13, 3.2 * len(names)),
        sharex=True,
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    for i, scenario in enumerate(names):
        for j, receiver in enumerate(RECEIVERS):
            here = axes[i, j]
            some = pick(rows, scenario=scenario, receiver=receiver)
            for row in sorted(some, key=lambda r: -WANTED.index(r["method"])):
                truth = row["series"]["truth_mm"]
                less = truth if error else [0.0] * len(truth)
                time = [k * SERIES_EVERY * TICK_S / 60 for k in range(len(truth))]
                shown = [v - t for v, t in zip(row["series"]["difference_mm"], less, strict=True)]
                here.plot(time, shown, color=COLOURS[row["method"]], lw=1.0, label=row["method"])
            if some and not error:
                here.plot(time, truth, "k--", lw=1.6, label="truth")
                here.set_ylim(min(truth) - 0.8, max(truth) + 0.8)
            elif error:
                here.set_ylim(-0.5, 0.5)
            here.set(title=f"{scenario}, {receiver} errors")
            here.grid(alpha=0.3)
        axes[i, 0].set_ylabel("error of mu3 - mu4, mm" if error else "mu3 - mu4, mm")
    for here in axes[-1]:
        here.set_xlabel("time, min")
    _legend_below(figure, axes.flat)
    return _save(figure, out, file)


def draw_fig9(result: dict[str, Any], out: Path) -> Path | None:
    """RMSE over N (Fig 9)."""
    rows = result.get("rows", [])
    if not rows:
        return None
    figure, axes = plt.subplots(1, len(RECEIVERS), figsize=(12, 4.8), sharey=True, layout="constrained")
    for here, receiver in zip(axes, RECEIVERS, strict=True):
        some = pick(rows, scenario="puncture", receiver=receiver, front=False, inputs=POSITIONS)
        for method, numbers in fig9(rows, receiver).items():
            if method in SAMPLED:
                here.plot(
                    list(numbers),
                    list(numbers.values()),
                    marker=MARKERS[method],
                    color=COLOURS[method],
                    label=method,
                )
            else:
                here.axhline(numbers[0], color=COLOURS[method], ls="--", label=method)
            lost = [n for n in numbers if diverged(pick(some, method=method, particles=n))[0]]
            here.plot(
                [n or NUMBERS[0] for n in lost],
                [numbers[n] for n in lost],
                "o",
                ms=14,
                mfc="none",
                mec="black",
                label="some runs diverged",
            )
        here.set(xscale="log", yscale="log", xlabel="particles N", title=f"slow puncture, {receiver} errors")
        here.set_xlim(80, 6300)
        here.set_xticks(NUMBERS, [str(n) for n in NUMBERS])
        _plain_log(here)
        here.xaxis.set_minor_locator(NullLocator())
        here.grid(alpha=0.3)
    axes[0].set_ylabel("RMSE of mu3 - mu4, mm")
    _legend_below(figure, axes)
    return _save(figure, out, "fig9-rmse.png")


def draw_fig10(result: dict[str, Any], out: Path) -> Path | None:
    """Share of diverged runs over N (Fig 10)."""
    rows = result.get("rows", []) + result.get("batches", [])
    if not rows:
        return None
    figure, axes = plt.subplots(1, len(RECEIVERS), figsize=(12, 4.3), sharey=True, layout="constrained")
    for here, receiver in zip(axes, RECEIVERS, strict=True):
        for k, method in enumerate(m for m in WANTED if m in SAMPLED):
            some = pick(
                rows, scenario="puncture", receiver=receiver, front=False, inputs=POSITIONS, method=method
            )
            counts = [(n, *diverged(pick(some, particles=n))) for n in NUMBERS]
            if not any(of for _, _, of in counts):
                continue
            at = [i + 0.2 * (k - 1.5) for i, (_, _, of) in enumerate(counts) if of]
            shares = [100 * bad / of for _, bad, of in counts if of]
            bars = here.bar(at, shares, width=0.2, color=COLOURS[method], label=method)
            here.bar_label(bars, [f"{bad}/{of}" for _, bad, of in counts if of], fontsize=7)
        here.set_xticks(range(len(NUMBERS)), [str(n) for n in NUMBERS])
        here.set(
            xlabel="particles N", title=f"slow puncture, {receiver} errors", xlim=(-0.6, 3.6), ylim=(0, 110)
        )
    axes[0].set_ylabel("diverged runs, %")
    _legend_below(figure, axes)
    return _save(figure, out, "fig10-divergence.png")


def draw_truthfulness(result: dict[str, Any], out: Path) -> Path | None:
    """Coverage of the 95 % intervals, per method and receiver."""
    rows = result.get("rows", [])
    methods = [m for m in WANTED if pick(rows, method=m)]
    if not methods:
        return None
    figure, axes = plt.subplots(1, 2, figsize=(12, 4.5), sharey=True, layout="constrained")
    for here, key, title in zip(
        axes, ("cover_difference", "cover_radius"), ("left-right difference", "absolute radius"), strict=True
    ):
        for k, receiver in enumerate(RECEIVERS):
            values = []
            for method in methods:
                number = USUAL if method in SAMPLED else 0
                values.append(
                    100
                    * mean(
                        pick(
                            rows,
                            method=method,
                            receiver=receiver,
                            particles=number,
                            front=False,
                            inputs=POSITIONS,
                        ),
                        key,
                    )
                )
            at = [i + 0.4 * k - 0.2 for i in range(len(methods))]
            bars = here.bar(at, values, width=0.4, label=receiver, color=("0.7", "tab:blue")[k])
            here.bar_label(bars, fmt="%.0f", fontsize=7)
        here.axhspan(90, 98, color="tab:green", alpha=0.4, zorder=0, label="90 to 98 %")
        here.set_xticks(range(len(methods)), methods, rotation=25, ha="right")
        here.set(title=f"95 % intervals of the {title}", ylim=(0, 105))
    axes[0].set_ylabel("truth inside, %")
    _legend_below(figure, axes)
    return _save(figure, out, "coverage.png")


def draw_speed(result: dict[str, Any], out: Path) -> Path | None:
    """Run time over N (Table III), with the library and the kernel."""
    speed = result.get("speed")
    if speed is None:
        return None
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.5), width_ratios=(3, 2))
    for method, cost in speed["methods_ms"].items():
        if "0" in cost:
            plain = method.split(",")[0]
            left.axhline(cost["0"], color=COLOURS[plain], ls=":" if "four" in method else "--", label=method)
        else:
            left.plot(
                [int(n) for n in cost],
                list(cost.values()),
                marker=MARKERS[method],
                color=COLOURS[method],
                label=method,
            )
    for number, ms in speed["library_ms"].items():
        left.plot(int(number), ms, "x", color="tab:orange", ms=10, mew=2, label="library `particles`, AUG-PF")
    if not isinstance(speed["kernel_ms"], str):
        kernel = speed["kernel_ms"]
        left.plot(
            [int(n) for n in kernel],
            list(kernel.values()),
            color="tab:cyan",
            marker=".",
            label="compiled MPF-PN",
        )
    left.set(
        xscale="log", yscale="log", xlabel="particles N", ylabel="ms per tick", title="run time per tick"
    )
    left.grid(alpha=0.3)
    _legend(left, loc="upper left")
    where = {k: v for k, v in speed["where"].items() if k != "calls_per_tick"}
    names = list(where)[::-1]
    right.barh(names, [100 * where[name] for name in names], color="0.6")
    right.set(xlabel="share of a tick, %", title=f"where MPF-PN spends it, N={USUAL}")
    return _save(figure, out, "run-time.png")


def draw_recordings(result: dict[str, Any], out: Path) -> Path | None:
    """The artificial drop on real recordings."""
    rows = result.get("recordings", [])
    folders = sorted({row["folder"] for row in rows})
    if not folders:
        return None
    figure, axes = plt.subplots(len(folders), 1, figsize=(9, 2.8 * len(folders)), squeeze=False)
    for here, folder in zip(axes[:, 0], folders, strict=True):
        some = pick(rows, folder=folder)
        for row in sorted(some, key=lambda r: -WANTED.index(r["method"])):
            series = row["series"]["difference_mm"]
            time = [2.0 * k / 60 for k in range(len(series))]
            here.plot(time, series, color=COLOURS[row["method"]], lw=1.0, label=row["method"])
        here.plot(time, some[0]["series"]["truth_mm"], "k--", lw=1.6, label="injected, and the tyres' own")
        here.set(title=Path(folder).name, ylabel="mu3 - mu4, mm", ylim=(-2.0, 4.5))
        here.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time, min")
    _legend(axes[0, 0], ncols=2)
    return _save(figure, out, "recordings.png")


def draw_survival(result: dict[str, Any], out: Path) -> Path | None:
    """Errors and stated errors hour by hour."""
    rows = result.get("survival", [])
    if not rows:
        return None
    figure, axes = plt.subplots(1, 2, figsize=(12, 4.3), sharex=True, sharey=True, layout="constrained")
    for row in rows:
        hours = range(1, len(row["hourly"]) + 1)
        for here, key in zip(axes, ("rmse_difference_mm", "std_difference_mm"), strict=True):
            here.plot(
                hours,
                [h[key] for h in row["hourly"]],
                color=COLOURS[row["method"]],
                marker=".",
                label=row["method"],
            )
    for here, title in zip(axes, ("RMSE of mu3 - mu4", "stated standard deviation"), strict=True):
        here.set(title=title, xlabel="hour", ylabel="mm", yscale="log")
        _plain_log(here)
        here.xaxis.set_major_locator(MaxNLocator(integer=True))
        here.grid(alpha=0.3)
    _legend_below(figure, axes)
    return _save(figure, out, "survival.png")


PAPER = ("mpf-pn-paper", "mpf-pn", "gaussian-sum", "aug-pf", "aug-ekf", "mpf-mn")
"""In Figs 4 to 8: the paper's four filters, and both of the product's."""
THINNED = 3
"""Figs 3 to 8 draw every third value of a series, so that the files stay small."""


def _series(result: dict[str, Any], scenario: str) -> dict[str, dict[str, list[float]]]:
    """Method -> what it estimated on the first drive of a scenario, white errors as the paper has them."""
    some = pick(result.get("rows", []), scenario=scenario, receiver="white", front=False, inputs=POSITIONS)
    return {
        row["method"]: {key: values[::THINNED] for key, values in row["series"].items()}
        for row in some
        if "series" in row
    }


def _minutes(values: list[float]) -> list[float]:
    return [k * THINNED * SERIES_EVERY * TICK_S / 60 for k in range(len(values))]


def _svg(figure: Figure, out: Path, name: str) -> Path:
    path = out / name
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
    return path


def _fig3(result: dict[str, Any], out: Path) -> Path:
    """Estimated trajectory on the true one."""
    route, series = paper_route(), _series(result, "balanced")
    figure, axes = plt.subplots(figsize=(4.5, 4.5), layout="constrained")
    every = slice(None, None, 100)
    axes.plot(route.east_m[every] / 1e3, route.north_m[every] / 1e3, color="tab:red", lw=3, label="true")
    found = series["mpf-pn-paper"]
    east, north = ([v / 1e3 for v in found[key]] for key in ("east_m", "north_m"))
    axes.plot(east, north, "k--", lw=1, label="mpf-pn-paper")
    axes.set(xlabel="east, km", ylabel="north, km", aspect="equal", title="Fig 3: trajectory")
    _legend(axes)
    return _svg(figure, out, "paper-fig3.svg")


def _wheels(result: dict[str, Any], out: Path, scenario: str, number: int) -> Path:
    """Means and square roots of Sigma of both rear wheels."""
    series = _series(result, scenario)
    figure, axes = plt.subplots(2, 2, figsize=(9, 5), sharex=True, sharey="row", layout="constrained")
    for j, side in enumerate(("left", "right")):
        for i, key in enumerate((f"{side}_mm", f"{side}_noise_mm")):
            for name in PAPER:
                if name in series:
                    values = series[name][key]
                    axes[i, j].plot(_minutes(values), values, color=COLOURS[name], lw=0.8, label=name)
            axes[i, j].grid(alpha=0.3)
        axes[0, j].set(title=f"Fig {number}: {scenario}, rear {side}")
        axes[1, j].set(xlabel="time, min", yscale="log")
    axes[0, 0].set(ylabel="mu, mm", ylim=(-6.0, 6.0))
    axes[1, 0].set(ylabel="root of Sigma, mm")
    _legend_below(figure, axes.flat)
    return _svg(figure, out, f"paper-fig{number}.svg")


def _difference(result: dict[str, Any], out: Path, scenario: str, number: int) -> Path:
    """mu3 - mu4 over time."""
    series = _series(result, scenario)
    figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
    for name in PAPER:
        if name in series:
            values = series[name]["difference_mm"]
            axes.plot(_minutes(values), values, color=COLOURS[name], lw=0.8, label=name)
    truth = next(iter(series.values()))["truth_mm"]
    axes.plot(_minutes(truth), truth, "k--", lw=1.4, label="truth")
    axes.set(xlabel="time, min", ylabel="mu3 - mu4, mm", title=f"Fig {number}: {scenario}")
    axes.set_ylim(min(truth) - 1.0, max(truth) + 1.0)
    axes.grid(alpha=0.3)
    _legend(axes, ncols=2)
    return _svg(figure, out, f"paper-fig{number}.svg")


def _over_numbers(result: dict[str, Any], out: Path) -> Iterable[Path]:
    """Figs 9 and 10: RMSE with its interval, and the share of diverged runs, over N; white errors."""
    rows = result["rows"]
    first, rmse = plt.subplots(figsize=(6, 4), layout="constrained")
    second, share = plt.subplots(figsize=(6, 3.5), layout="constrained")
    cell = {"scenario": "puncture", "receiver": "white", "front": False, "inputs": POSITIONS}
    for k, method in enumerate(WANTED):
        found = [
            (n, interval(some, "rmse_difference_m", 1e3))
            for n in (NUMBERS if method in SAMPLED else (0,))
            if (some := pick(rows, **cell, method=method, particles=n))
        ]
        if method not in SAMPLED:
            for _, (middle, _half) in found:
                rmse.axhline(middle, color=COLOURS[method], ls="--", lw=1, label=method)
            continue
        at = [n * 1.04 ** (k - 2) for n, _ in found]
        middles, halves = ([pair[i] for _, pair in found] for i in (0, 1))
        rmse.errorbar(
            at, middles, halves, color=COLOURS[method], marker=MARKERS[method], capsize=3, label=method
        )
        both = rows + result.get("batches", [])
        lost = [(n, *diverged(pick(both, **cell, method=method, particles=n))) for n in NUMBERS]
        lost = [(n, bad, of) for n, bad, of in lost if of]
        share.plot(
            [n for n, _, _ in lost],
            [100 * bad / of for _, bad, of in lost],
            color=COLOURS[method],
            marker=MARKERS[method],
            label=method,
        )
    rmse.set(yscale="log", ylabel="RMSE of mu3 - mu4, mm", title="Fig 9: slow puncture")
    share.set(ylabel="diverged runs, %", ylim=(-3, 103), title="Fig 10: slow puncture")
    for axes in (rmse, share):
        axes.set(xscale="log", xlabel="particles N")
        axes.set_xticks(NUMBERS, [str(n) for n in NUMBERS])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid(alpha=0.3)
        _legend(axes)
    _plain_log(rmse)
    return _svg(first, out, "paper-fig9.svg"), _svg(second, out, "paper-fig10.svg")


def draw_paper(result: dict[str, Any], out: Path) -> list[Path]:
    """Figs 3 to 10 as SVG; needs the Monte-Carlo runs."""
    out.mkdir(parents=True, exist_ok=True)
    matplotlib.rcParams["svg.hashsalt"] = "tpmsd"
    return [
        _fig3(result, out),
        _wheels(result, out, "balanced", 4),
        _difference(result, out, "balanced", 5),
        _wheels(result, out, "unbalanced", 6),
        _difference(result, out, "unbalanced", 7),
        _difference(result, out, "puncture", 8),
        *_over_numbers(result, out),
    ]


DRAWERS: tuple[Callable[[dict[str, Any], Path], Path | None], ...] = (
    draw_route,
    draw_fig8,
    draw_error,
    draw_fig9,
    draw_fig10,
    draw_truthfulness,
    draw_speed,
    draw_recordings,
    draw_survival,
)


def draw_all(result: dict[str, Any], out: Path) -> list[Path]:
    """All figures that the result has something for."""
    return [path for drawer in DRAWERS if (path := drawer(result, out)) is not None]
