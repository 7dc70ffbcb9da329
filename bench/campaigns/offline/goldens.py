"""What the program says of a fixed set of drives, stored, so that a change of its structure shows.

    python -m bench run goldens --write     diagnose, calibrate and replay the drives; store the answers
    python -m bench run goldens --compare   the same, and every difference from what is stored (exit code 1)
    python -m bench run goldens --compare --only null,growth

The drives are short, so that all of them take three minutes: drawn ones of the independent worlds, one piece
of a multi-body car, and recordings where they are at hand. Numbers differ where they part by more than a
hundredth of their size and a twentieth of their standard deviation.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.offline.diagnosis.draw import draw_case
from bench.places import OUT, RECORDINGS, REPO
from bench.worlds import kinematic, multibody
from bench.worlds.folder import write_folder
from bench.worlds.instruments import observe
from bench.worlds.spec import Spec

STORE = Path(__file__).with_suffix(".json")
CACHE = OUT / "goldens"
DRAWN = {
    "null": ("nothing", 0.0, 7, 480.0),
    "null-wander": ("nothing_wander", 0.0, 11, 420.0),
    "growth": ("centrifugal_growth", 2.0, 3, 420.0),
    "leak": ("radius_change", 2.0, 5, 420.0),
    "lean": ("load_transfer_lateral", 2.0, 6, 420.0),
    "tooth": ("tone_ring_error", 2.0, 8, 420.0),
    "dip": ("strange_speed_hump", 2.0, 4, 480.0),
    "slip-latency": ("longitudinal_slip+gnss_latency", 2.0, 9, 480.0),
}
"""Kind, strength, seed and length (s) of the drives of the kinematic world."""
RECORDED = ("rav4-suburb-60s", "van-oval", "van-motorway-lost-counts")
MULTIBODY_S = 240.0
RELATIVE, OF_STD = 0.01, 0.05


def drives(folder: Path, only: set[str]) -> Iterator[tuple[str, Path]]:
    """Write the drives that are wanted, one after the other: name and folder."""

    def wanted(name: str) -> bool:
        return not only or name in only

    for name, (kind, strength, seed, duration_s) in DRAWN.items():
        if wanted(name):
            case = draw_case(kind, strength, seed)
            spec = replace(case.spec, duration_s=duration_s)
            rng = np.random.default_rng(case.world_seed)
            target = folder / name
            write_folder(observe(kinematic.course(spec, rng), spec, rng, case.world_seed), target)
            yield name, target
    if wanted("multibody"):
        yield "multibody", _multibody(folder / "multibody")
    for name in RECORDED:
        if wanted(name) and (RECORDINGS / name).is_dir():
            yield name, RECORDINGS / name


def _multibody(target: Path) -> Path:
    car, seed = 2, 5
    p = multibody.parameters(car)
    kept = CACHE / f"course-{multibody.FORMAT}-{car}-{seed}-{MULTIBODY_S:.0f}s.npz"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(kept, **multibody.integrated(car, "rural", MULTIBODY_S, seed))
    with np.load(kept) as loaded:
        course = multibody.course_of(dict(loaded), p)
    spec = Spec(
        duration_s=float(course.time_s[-1]),
        driven="rear",
        track_front_m=float(p.T_f),
        track_rear_m=float(p.T_r),
        wheelbase_m=float(p.a + p.b),
        radius_m=float(p.R_w),
    )
    write_folder(observe(course, spec, np.random.default_rng(seed), seed), target)
    return target


def answers(folder: Path) -> dict[str, Any]:
    """What diagnosis, calibration and replay say of a drive."""
    diagnosis = _json("diagnose", folder, "--model-out", os.devnull)
    calibration = _json("calibrate", folder)
    replay = _json("replay", folder)
    found = diagnosis.get("findings", [])
    return {
        "verdict": diagnosis.get("verdict", diagnosis.get("error")),
        "findings": [
            {
                "effect": one["effect"],
                "confidence": one["confidence"],
                "parameters": {k: [q["value"], q["std"]] for k, q in one["parameters"].items()},
                "place": [one["where"]["wheels"], one["where"]["channel"], one["where"]["covariate"]],
                "gain_per_s": one["heldout"]["loglik_gain_per_s"],
            }
            for one in found
        ],
        "unexplained": bool((diagnosis.get("unexplained") or {}).get("significant")),
        "calibration": calibration if "error" in calibration else _calibrated(calibration),
        "alarms": [[a["kind"], a["wheel"], round(a["time"], 1)] for a in replay.get("alarms", [])],
        "deviations_mm": {
            wheel: [one["deviation_mm"], one["std_mm"]] for wheel, one in replay.get("wheels", {}).items()
        },
    }


def _calibrated(document: dict[str, Any]) -> dict[str, list[float | None]]:
    """Every value of a calibration that has a standard deviation beside it, by its path."""
    out: dict[str, list[float | None]] = {}

    def walk(at: str, value: Any) -> None:
        if isinstance(value, dict):
            for name, one in value.items():
                std = next((value[k] for k in (f"{name}_std", "std") if k in value and k != name), None)
                if isinstance(one, float) and name != "std" and not name.endswith("_std"):
                    out[f"{at}{name}"] = [one, std if isinstance(std, float) else None]
                else:
                    walk(f"{at}{name}.", one)

    walk("", {k: v for k, v in document.items() if k not in ("program", "input", "elapsed_s")})
    return out


def _json(command: str, folder: Path, *more: str) -> dict[str, Any]:
    call = [sys.executable, "-m", "tpmsd", command, str(folder), "--json", "-", *more]
    single = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    env = {**os.environ, **single}
    done = subprocess.run(call, cwd=REPO, env=env, capture_output=True, text=True, check=False)
    if done.returncode and not done.stdout:  # too little data is a document, and exit code 3
        last = done.stderr.strip().splitlines()[-1] if done.stderr.strip() else ""
        return {"error": f"exit code {done.returncode}: {last.replace(str(folder), folder.name)}"}
    document = json.loads(done.stdout)
    assert isinstance(document, dict)
    return document


def _moved(before: list[Any], now: list[Any], at: str) -> Iterator[str]:
    """Return a line if an estimate has moved by more than its tolerance."""
    size = max(RELATIVE * abs(before[0]), OF_STD * (before[1] or 0.0))
    if abs(before[0] - now[0]) > size + 1e-12:
        std = "" if before[1] is None else f" (std {before[1]:.3g})"
        yield f"{at}: {before[0]:.5g} -> {now[0]:.5g}{std}"


def differences(before: Any, now: Any, at: str = "") -> Iterator[str]:
    """Return the differences between two answers, a line each."""
    if _is_estimate(before) and _is_estimate(now):
        yield from _moved(before, now, at)
    elif isinstance(before, dict) and isinstance(now, dict):
        for key in sorted({*before, *now}):
            yield from differences(before.get(key), now.get(key), f"{at}.{key}" if at else str(key))
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for k, (one, other) in enumerate(zip(before, now, strict=True)):
            yield from differences(one, other, f"{at}[{k}]")
    elif isinstance(before, float) and isinstance(now, float):
        if not math.isclose(before, now, rel_tol=RELATIVE, abs_tol=1e-6):
            yield f"{at}: {before:.5g} -> {now:.5g}"
    elif before != now:
        yield f"{at}: {_short(before)} -> {_short(now)}"


def _is_estimate(value: Any) -> bool:
    number = isinstance(value, list) and len(value) == 2 and isinstance(value[0], float)
    return number and (value[1] is None or isinstance(value[1], float))


def _short(value: Any) -> str:
    entries = value if isinstance(value, list) else []
    names = [one.get("effect", "?") for one in entries if isinstance(one, dict)]
    return " ".join(names) if names else json.dumps(value)


def options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--write", action="store_true", help="store the answers")
    what.add_argument(
        "--compare", action="store_true", help="tell what differs from the stored ones (default)"
    )
    parser.add_argument("--only", default="", help="names of drives, comma-separated")
    parser.add_argument("--store", type=Path, default=STORE, metavar="FILE", help=f"default: {STORE.name}")


def main(args: argparse.Namespace) -> int:
    """Write or compare; 1 if something differs."""
    only = set(filter(None, args.only.split(",")))
    say: Callable[[str], None] = lambda text: print(text, flush=True)  # noqa: E731
    known: dict[str, Any] = json.loads(args.store.read_text()) if args.store.exists() else {}
    different = 0
    with tempfile.TemporaryDirectory() as folder:
        for name, drive in drives(Path(folder), only):
            begun = time.monotonic()
            now = json.loads(json.dumps(answers(drive)))
            spent = time.monotonic() - begun
            names = " ".join(one["effect"] for one in now["findings"]) or "-"
            lines = list(differences(known.get(name), now)) if not args.write else []
            different += len(lines)
            say(f"{name}: {now['verdict']}, {names} ({spent:.0f} s)")
            for line in lines:
                say(f"    {line}")
            known[name] = now
    if args.write:
        args.store.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    else:
        say("no difference" if not different else f"{different} differences")
    return int(bool(different))
