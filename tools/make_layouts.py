"""Writes docs/layouts: what Foxglove and PlotJuggler show of `tpmsd replay --mcap`.

Run it again when the topics change: `python tools/make_layouts.py`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tpmsd.foundation.wheels import WHEELS

COLORS = {"fl": "#0072B2", "fr": "#D55E00", "rl": "#009E73", "rr": "#CC79A7"}
FOLDER = Path(__file__).resolve().parent.parent / "docs" / "layouts"


def radii(prefix: str) -> list[tuple[str, str, str, float]]:
    """(topic, field, colour, line width) of the four wheels with their bands."""
    middle = "deviation_mm" if not prefix else f"{prefix}mm"
    names = ((middle, 2.0), (f"{prefix}lower_mm", 0.5), (f"{prefix}upper_mm", 0.5))
    return [(f"/wheel/{w}", name, COLORS[w], size) for w in WHEELS for name, size in names]


PLOTS: dict[str, list[tuple[str, str, str, float]]] = {
    "radius minus nominal (mm)": radii(""),
    "change against the baseline (mm)": radii("change_"),
    "probability of a deflation": [(f"/wheel/{w}", "deflation_probability", COLORS[w], 2.0) for w in WHEELS],
    "speed (m/s)": [("/motion", "speed_mps", "#000000", 2.0)],
}


def foxglove() -> dict[str, Any]:
    """A layout as Foxglove exports it: map and log on the left, plots on the right."""
    panels: dict[str, Any] = {
        "map!1": {"topicColors": {}, "layer": "custom", "customTileUrl": "", "disabledTopics": []},
        "RosOut!1": {"searchTerms": [], "minLogLevel": 1, "topicToRender": "/alarms"},
    }
    for number, (title, series) in enumerate(PLOTS.items(), 1):
        panels[f"Plot!{number}"] = {
            "title": title,
            "paths": [
                {
                    "value": f"{topic}.{name}",
                    "enabled": True,
                    "timestampMethod": "headerStamp",
                    "color": color,
                    "lineSize": size,
                    "label": f"{topic} {name}",
                }
                for topic, name, color, size in series
            ],
            "showXAxisLabels": True,
            "showYAxisLabels": True,
            "showLegend": False,
            "isSynced": True,
            "xAxisVal": "timestamp",
        }
    right: Any = f"Plot!{len(PLOTS)}"
    for number in range(len(PLOTS) - 1, 0, -1):
        share = 100 / (len(PLOTS) - number + 1)
        split = {"direction": "column", "splitPercentage": share}
        right = {**split, "first": f"Plot!{number}", "second": right}
    left = {"direction": "column", "first": "map!1", "second": "RosOut!1", "splitPercentage": 65}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": left, "second": right, "splitPercentage": 40},
    }


def plotjuggler() -> str:
    """A layout as PlotJuggler saves it: one plot above the other."""
    share = ";".join([f"{1 / len(PLOTS):.3f}"] * len(PLOTS))
    lines = [
        "<?xml version='1.0' encoding='UTF-8'?>",
        "<root>",
        ' <tabbed_widget name="Main Window" parent="main_window">',
        '  <Tab tab_name="tyres" containers="1">',
        "   <Container>",
        f'    <DockSplitter orientation="-" sizes="{share}" count="{len(PLOTS)}">',
    ]
    for title, series in PLOTS.items():
        lines.append(f'     <DockArea name="{title}">')
        lines.append('      <plot style="Lines" mode="TimeSeries">')
        lines += [
            f'       <curve name="{topic}/{name}" color="{color}"/>' for topic, name, color, _ in series
        ]
        lines += ["      </plot>", "     </DockArea>"]
    lines += ["    </DockSplitter>", "   </Container>", "  </Tab>", ' <currentTabIndex index="0"/>']
    lines += [" </tabbed_widget>", "</root>", ""]
    return "\n".join(lines)


def main() -> None:
    """Write both."""
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / "foxglove.json").write_text(json.dumps(foxglove(), indent=1) + "\n", encoding="utf-8")
    (FOLDER / "plotjuggler.xml").write_text(plotjuggler(), encoding="utf-8")


if __name__ == "__main__":
    main()
