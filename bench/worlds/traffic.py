"""Trajectories of a traffic simulator: SUMO drives one car through generated networks full of others.

In: a seed, a folder for work and memory. Out: `Course`. Networks are drawn for each seed (`netgenerate`:
random, grid and spider towns with lights, several lanes, speeds from 30 to 100 km/h); some hundred other cars
make it stop, follow and change lanes. SUMO moves points along polylines and jumps between lanes, so the path
is smoothed over some metres and its curvature limited to what a car can follow; speed is smoothed over half a
second. Heights are a smooth random field, for the generator's networks are flat.

Needs the extra `bench` (`eclipse-sumo`, which ships its programs).

Source: Lopez et al. (2018), Microscopic traffic simulation using SUMO, IEEE ITSC. Car-following: the
extended intelligent driver model, Salles, Kaufmann and Reuss (2020), SUMO conference.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from bench.worlds.course import Course, rigid, summed

Array = NDArray[np.float64]
STEP_S = 0.02
FRAME_S = 0.1
"""Step of the traffic simulation."""
PATH_STEP_M = 0.5
PATH_SMOOTH_M = 5.0
"""Standard deviation of the smoothing along the path: half a car's turning circle."""
SPEED_SMOOTH_S = 0.4
TIGHTEST_PER_M = 1.0 / 6.0
"""A passenger car's smallest turning circle is some 11 m wide."""
MAX_LATERAL_MPS2 = 4.5
SPREADS = 30
OTHERS_PER_KM_LANE = 2.5
MAX_OTHERS = 120
EARLIEST_S = 120.0
"""The car sets off when the streets have filled."""


@dataclass(frozen=True)
class Trace:
    """What the simulator says of the car, every 0.1 s."""

    x_m: Array
    y_m: Array
    speed_mps: Array
    network: str


class NoSumoError(RuntimeError):
    """The traffic simulator is not installed."""


def sumo_home() -> Path:
    """Where the simulator's programs are; NoSumoError without them."""
    try:
        import sumo
    except ImportError:
        raise NoSumoError("the traffic simulator is missing: pip install 'tpmsd[bench]'") from None
    return Path(str(sumo.SUMO_HOME))


def _call(program: str, *words: str) -> None:
    home = sumo_home()
    done = subprocess.run(
        [str(home / "bin" / program), *words],
        env={**os.environ, "SUMO_HOME": str(home)},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"{program}: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")


def network(rng: np.random.Generator, file: Path) -> str:
    """Generate a network; its kind."""
    kind = str(rng.choice(["random", "random", "grid", "spider"]))
    speed = float(rng.choice([8.3, 13.9, 13.9, 19.4, 27.8]))
    far = {8.3: 120, 13.9: 250, 19.4: 500, 27.8: 900}[speed]
    words = ["--seed", str(int(rng.integers(1, 10**6))), "--tls.guess", "true", "-o", str(file)]
    words += ["--default.speed", f"{speed}", "--default.lanenumber", str(int(rng.integers(1, 4)))]
    words += [
        "--junctions.limit-turn-speed",
        f"{float(rng.uniform(2.0, 3.8)):.2f}",
        "--no-turnarounds",
        "false",
    ]
    if kind == "random":
        near = str(int(0.4 * far))
        words += ["--rand", "--rand.iterations", "90", "--rand.max-distance", str(far)]
        words += ["--rand.min-distance", near, "--rand.min-angle", "40"]
    elif kind == "grid":
        words += ["--grid", "--grid.number", "7", "--grid.length", str(far)]
        words += ["--perturb-x", f"{0.15 * far:.0f}", "--perturb-y", f"{0.15 * far:.0f}"]
    else:
        words += ["--spider", "--spider.arm-number", "9", "--spider.circle-number", "5"]
        words += ["--spider.space-radius", str(far)]
    _call("netgenerate", *words)
    return f"{kind}, {speed * 3.6:.0f} km/h"


def simulated(seed: int, duration_s: float) -> Trace:
    """One car's way through the traffic of a network of its own."""
    rng = np.random.default_rng([seed, 77])
    with tempfile.TemporaryDirectory(prefix="traffic-") as name:
        folder = Path(name)
        kind = network(rng, folder / "net.xml")
        edges, lane_km = _edges(folder / "net.xml")
        end = EARLIEST_S + duration_s + 30.0
        (folder / "trips.xml").write_text(_trips(edges, lane_km, end, rng), encoding="utf-8")
        _call(
            "sumo",
            *("-n", str(folder / "net.xml"), "-r", str(folder / "trips.xml"), "--step-length", f"{FRAME_S}"),
            *("--seed", str(int(rng.integers(1, 10**6))), "--fcd-output", str(folder / "fcd.xml")),
            *("--device.fcd.explicit", "ego", "--end", f"{end}", "--ignore-route-errors", "true"),
            *("--no-step-log", "true", "--lanechange.duration", "3", "--time-to-teleport", "120"),
        )
        rows = [
            (float(each.get("x", "nan")), float(each.get("y", "nan")), float(each.get("speed", "nan")))
            for _, each in ElementTree.iterparse(folder / "fcd.xml")
            if each.tag == "vehicle"
        ]
    if not rows:
        raise RuntimeError(f"traffic of seed {seed}: the car never set off")
    x, y, speed = np.array(rows).T
    return Trace(x, y, speed, kind)


def _edges(file: Path) -> tuple[list[str], float]:
    names, lane_m = [], 0.0
    for edge in ElementTree.parse(file).getroot().iter("edge"):
        if edge.get("function") is None:
            names.append(str(edge.get("id")))
            lane_m += sum(float(lane.get("length", "0")) for lane in edge.iter("lane"))
    return names, lane_m / 1000.0


def _trips(edges: list[str], lane_km: float, end_s: float, rng: np.random.Generator) -> str:
    number = int(min(OTHERS_PER_KM_LANE * lane_km, MAX_OTHERS))
    style = 'carFollowModel="EIDM" sigma="0.3" speedFactor="normc(1,0.1,0.8,1.2)"'
    lines = ["<routes>", f'<vType id="car" accel="1.8" decel="2.5" {style}/>']
    entries = [_trip("ego", EARLIEST_S, edges, 40, rng)]
    entries += [_trip(f"o{k}", float(rng.uniform(0.0, 0.6 * end_s)), edges, 5, rng) for k in range(number)]
    lines += [line for _, line in sorted(entries)]
    return "\n".join([*lines, "</routes>", ""])


def _trip(
    name: str, depart_s: float, edges: list[str], stops: int, rng: np.random.Generator
) -> tuple[float, str]:
    """Departure and definition of a way over `stops` edges."""
    first, *via, last = (str(edge) for edge in rng.choice(edges, stops + 2))
    where = f'from="{first}" to="{last}" via="{" ".join(via)}"'
    return depart_s, f'<trip id="{name}" type="car" depart="{depart_s:.1f}" {where}/>'


def course_of(trace: Trace, rng: np.random.Generator, hilly: float = 0.0) -> Course:
    """The smoothed motion of a car on the trace, every 20 ms; `hilly` is the slope's standard deviation."""
    speed10 = gaussian_filter1d(trace.speed_mps, SPEED_SMOOTH_S / FRAME_S)
    frames = np.arange(len(speed10)) * FRAME_S
    time_s: Array = np.arange(0.0, frames[-1], STEP_S)
    speed = np.maximum(CubicSpline(frames, speed10)(time_s), 0.0)
    curvature, along = _curvature(trace)
    distance = summed(speed, time_s)
    fast = np.interp(along, distance * along[-1] / max(float(distance[-1]), 1.0), speed)
    curvature = _drivable(curvature, fast)
    bend = np.interp(distance * along[-1] / max(float(distance[-1]), 1.0), along, curvature)
    slope = np.zeros(len(time_s))
    if hilly > 0.0:
        knots = np.arange(0.0, distance[-1] + 800.0, 250.0)
        slope = np.clip(CubicSpline(knots, rng.normal(0, hilly, len(knots)))(distance), -0.12, 0.12)
    return rigid(time_s, speed, bend, slope, float(rng.uniform(-3, 3)))


def _curvature(trace: Trace) -> tuple[Array, Array]:
    """Curvature over the arc length of the smoothed path."""
    steps = np.hypot(np.diff(trace.x_m), np.diff(trace.y_m))
    kept = np.concatenate([[True], steps > 0.02])
    x, y = trace.x_m[kept], trace.y_m[kept]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    even: Array = np.arange(0.0, along[-1], PATH_STEP_M)
    width = PATH_SMOOTH_M / PATH_STEP_M
    px, py = (gaussian_filter1d(np.interp(even, along, values), width) for values in (x, y))
    heading = np.unwrap(np.arctan2(np.gradient(py), np.gradient(px)))
    return gaussian_filter1d(np.gradient(heading, PATH_STEP_M), 0.4 * width), even


def _drivable(curvature: Array, speed: Array) -> Array:
    """Curvature within the car's limits over the way: what is too much is spread over the metres around."""
    most = np.minimum(TIGHTEST_PER_M, MAX_LATERAL_MPS2 / np.maximum(speed, 1.0) ** 2)
    for _ in range(SPREADS):
        within = np.clip(curvature, -most, most)
        curvature = within + gaussian_filter1d(curvature - within, PATH_SMOOTH_M / PATH_STEP_M)
    return np.clip(curvature, -most, most)


def save(trace: Trace, file: Path) -> None:
    """Keep a trace: centimetres and centimetres a second."""
    whole = {"x": trace.x_m, "y": trace.y_m, "speed": trace.speed_mps}
    arrays = {key: np.round(values * 100).astype(np.int32) for key, values in whole.items()}
    part = file.with_suffix(".part.npz")
    # neighbours differ little, and small numbers pack well
    np.savez_compressed(part, network=trace.network, **{k: np.diff(v, prepend=0) for k, v in arrays.items()})
    part.rename(file)


def load(file: Path) -> Trace:
    """A trace that was kept."""
    with np.load(file) as kept:
        x, y, speed = (np.cumsum(kept[key]) / 100.0 for key in ("x", "y", "speed"))
        return Trace(x, y, speed, str(kept["network"]))


def remembered(seed: int, duration_s: float, folder: Path) -> Trace:
    """The trace of a seed, simulated once."""
    file = folder / f"traffic-2-{seed}-{duration_s:.0f}s.npz"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        save(simulated(seed, duration_s), file)
    return load(file)
