"""How well the diagnosis does on drives of a world that shares nothing with its catalogue.

    python benchmarks/bench_diagnose.py            a small run: minutes
    python benchmarks/bench_diagnose.py --full     200 drives of nothing, 20 per effect and strength: hours

Each drive (car, road, receiver, bus drawn anew) is written as a drive folder by `tests/worlds`; what it
conceals goes into another folder, which only the scorer opens. The diagnosis is given the drive folder
alone, through the reader of `tpmsd diagnose`. "Can tell" is the log-likelihood that the true effect would
bring under the known noise.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
from scipy.stats import beta

from tests.diagnosis.recorded import recording_of
from tests.worlds.folder import write_folder
from tests.worlds.kinematic import Spec, draw_spec, drive
from tpmsd.cli.diagnose import read_recording
from tpmsd.diagnosis.channels import Reader
from tpmsd.diagnosis.diagnose import diagnose, first_noise
from tpmsd.diagnosis.motion import reference
from tpmsd.diagnosis.response import radius_columns
from tpmsd.diagnosis.whitening import whiten
from tpmsd.physics.model import ExtendedModel
from tpmsd.report.diagnosis_document import diagnosis_document

LOSS = 0.0046
"""Relative change of radius of a 20 % pressure loss: strength 1."""
TELLS = 16.0
"""Log-likelihood of the true effect from which a drive is counted as able to tell."""
SIZES: dict[str, dict[str, float]] = {
    "centrifugal_growth": {"coefficient": 1 / 900},
    "thermal_growth": {"amplitude_m": 1.0},
    "load_transfer_longitudinal": {"coefficient": 1 / 2},
    "load_transfer_lateral": {"coefficient": 1 / 2},
}
"""Parameters per metre of radius change, at 30 m/s and 2 m/s2."""


def concealed(
    effect: str, strength: float, spec: Spec, rng: np.random.Generator
) -> dict[str, dict[str, Any]]:
    """The physics of an effect at a strength, as the world takes it."""
    size = strength * LOSS * spec.radius_m
    if effect in SIZES:
        out: dict[str, Any] = {name: per * size for name, per in SIZES[effect].items()}
        if effect == "thermal_growth":
            out["time_constant_s"] = float(rng.uniform(250, 700))
        return {effect: out}
    end = spec.duration_s
    wheel = str(rng.choice(["fl", "fr", "rl", "rr"]))
    others: dict[str, dict[str, Any]] = {
        "longitudinal_slip": {
            "slip_per_accel": strength * LOSS / 2,
            "slip_per_speed2": strength * LOSS / 2 * 2.7e-4,
        },
        "lateral_slip": {"coefficient": strength * LOSS},
        "gnss_latency": {"latency_s": strength * 0.08},
        "antenna_lever_arm": {
            "forward_m": strength * 0.8,
            "left_m": strength * float(rng.choice([-0.3, 0.3])),
        },
        "track_width_error": {"rear_m": strength * 0.03, "front_m": -strength * 0.02},
        "yaw_rate_bias": {"bias": strength * 1e-3},
        "yaw_rate_scale": {"scale": 1.0 + strength * 0.02},
        "tone_ring_error": {"wheel": wheel, "amplitude_rad": strength * 0.01},
        "radius_change": {
            "wheel": wheel,
            "deviation_m": -size,
            "onset_s": float(rng.uniform(0.2, 0.6)) * end,
            "duration_s": float(rng.choice([0.0, 60.0, 300.0])),
        },
        "strange_speed_hump": {
            "at_mps": float(rng.uniform(17, 24)),
            "width_mps": float(rng.uniform(2, 4)),
            "wheels": [2, 3] if rng.random() < 0.5 else [0, 1],
            "size_m": -size,
        },
        "strange_camber": {"wheels": [int(rng.integers(0, 4))], "size_m": size},
        "strange_span": {
            "wheels": [int(rng.integers(0, 4))],
            "from_s": 0.35 * end,
            "to_s": 0.35 * end + float(rng.uniform(120, 300)),
            "size_m": -size,
        },
    }
    return {effect: others.get(effect, {})}


EFFECTS = (
    *SIZES,
    *("longitudinal_slip", "lateral_slip", "road_grade", "gnss_latency", "antenna_lever_arm"),
    *("track_width_error", "yaw_rate_bias", "yaw_rate_scale", "tone_ring_error", "radius_change"),
)
STRANGE = ("strange_speed_hump", "strange_camber", "strange_span")


def can_tell(spec: Spec, seed: int) -> float:
    """Log-likelihood that the true physics brings over the calibrated rolling model: half the squared
    whitened difference between this drive and the same drive without it, with calibration projected out.
    """
    rolling = dataclasses.replace(spec, physics={"no_shortening": {}})
    with_it, without = (recording_of(drive(each, seed), counted=False) for each in (spec, rolling))
    reader = Reader(without, reference(without))
    other = Reader(with_it, reader.reference)
    change = other.windows.measured - other.predict(ExtendedModel())
    change = change - (reader.windows.measured - reader.predict(ExtendedModel()))
    noise = dataclasses.replace(
        first_noise(reader),
        rough_m=spec.rough,
        speed_mps=spec.doppler_mps,
        speed_white_mps=0.002,
        speed_memory=math.exp(-1.0 / spec.doppler_tau_s),
        cross_mps=spec.doppler_mps,
        cross_white_mps=0.002,
        gyro_radps=spec.gyro_std / math.sqrt(50.0) + 5e-5,
        white_m=spec.position_white_m,
        slow_m=spec.position_slow_m,
        slow_tau_s=spec.position_tau_s,
        clock_s=1e-4,
    )
    columns = np.concatenate([change[:, :, None], radius_columns(reader).stack()], axis=2)
    white, _ = whiten(reader.windows, noise, columns)
    rows = white.reshape(-1, columns.shape[2])
    left = rows[:, 0] - rows[:, 1:] @ np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0]
    return 0.5 * float(left @ left)


def interval(hits: int, total: int) -> str:
    """Share with its 95 % interval (Clopper and Pearson)."""
    if total == 0:
        return "     none"
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, total - hits + 1))
    high = 1.0 if hits == total else float(beta.ppf(0.975, hits + 1, total - hits))
    return f"{hits:4d}/{total:<4d} {hits / total:6.1%} [{low:.1%}, {high:.1%}]"


def one(kind: str, strength: float, seed: int, work: Path) -> dict[str, Any]:
    """Draw, write, diagnose and score a drive."""
    rng = np.random.default_rng([seed, sum(map(ord, kind)), round(100 * strength)])
    effects = kind.split("+") if kind != "nothing" else []
    spec = draw_spec(rng, hilly=0.03 * strength if "road_grade" in effects else 0.0)
    for effect in effects:
        spec.physics.update(concealed(effect, strength, spec, rng))
    world_seed = int(rng.integers(2**31))
    folder, sealed = work / "drive", work / "sealed"
    write_folder(drive(spec, world_seed), folder)
    sealed.mkdir(exist_ok=True)
    tell = can_tell(spec, world_seed) if effects else 0.0
    (sealed / "truth.json").write_text(
        json.dumps({"effects": spec.physics, "can_tell": tell}), encoding="utf-8"
    )
    begun = time.process_time()
    recording = read_recording(folder)
    document = diagnosis_document(diagnose([recording]), None)
    seconds = time.process_time() - begun
    truth = json.loads((sealed / "truth.json").read_text(encoding="utf-8"))
    return {**score(effects, truth, document), "factor": spec.duration_s / seconds}


def score(effects: list[str], truth: dict[str, Any], document: dict[str, Any]) -> dict[str, Any]:
    """Compare the findings with the truth."""
    names = [finding["effect"] for finding in document["findings"]]
    wanted = ["unknown" if effect.startswith("strange") else effect for effect in effects]
    errors: list[float] = []
    for finding in document["findings"]:
        if finding["effect"] not in effects:
            continue
        true = truth["effects"].get(finding["effect"], {})
        for name, value in true.items():
            got = finding["parameters"].get(name)
            if got is not None and isinstance(value, float) and got["std"]:
                errors.append((got["value"] - value) / got["std"])
    sure_wrong = any(
        finding["effect"] not in wanted and finding["confidence"] > 0.9 for finding in document["findings"]
    )
    return {
        "tells": truth["can_tell"],
        "names": names,
        "first": bool(names) and bool(wanted) and names[0] in wanted,
        "all": all(effect in names for effect in wanted),
        "false": sum(name not in wanted for name in names),
        "findings": len(names),
        "sure_wrong": sure_wrong,
        "errors": errors,
        "unexplained": document["unexplained"]["significant"],
    }


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--full", action="store_true", help="all drives that the proof asks for")
    parser.add_argument("--clean", type=int, default=10, help="drives with nothing missing (default: 10)")
    parser.add_argument("--per", type=int, default=2, help="drives per effect and strength (default: 2)")
    parser.add_argument("--strengths", default="0.25,0.5,1,2")
    parser.add_argument("--only", default="", help="these kinds alone, comma-separated; a+b is a pair")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args()
    clean, per = (200, 20) if args.full else (args.clean, args.per)
    strengths = [float(part) for part in args.strengths.split(",")]
    pairs = (
        "centrifugal_growth+thermal_growth",
        "longitudinal_slip+gnss_latency",
        "radius_change+thermal_growth",
    )
    kinds = args.only.split(",") if args.only else ["nothing", *EFFECTS, *STRANGE, *pairs]
    results: dict[tuple[str, float], list[dict[str, Any]]] = {}
    with tempfile.TemporaryDirectory() as name:
        for kind in kinds:
            for strength in [0.0] if kind == "nothing" else strengths:
                for k in range(clean if kind == "nothing" else per):
                    result = one(kind, strength, args.seed * 100_000 + k, Path(name))
                    results.setdefault((kind, strength), []).append(result)
                    if args.verbose:
                        print(f"  {kind} {strength:g}: {result}", flush=True)
                line(kind, strength, results[kind, strength])
    totals([result for group in results.values() for result in group])


def line(kind: str, strength: float, group: list[dict[str, Any]]) -> None:
    """One line of the table."""
    if kind == "nothing":
        wrong = sum(bool(result["findings"]) for result in group)
        print(f"{'nothing missing, yet found':46} {interval(wrong, len(group))}", flush=True)
        return
    able = [result for result in group if result["tells"] >= TELLS]
    first = sum(result["first"] for result in able)
    every = sum(result["all"] for result in able)
    tells = float(np.median([result["tells"] for result in group]))
    print(
        f"{kind[:38]:38} x{strength:<5g} first {interval(first, len(able))}  all {every}/{len(able)}"
        f"  can tell: {tells:.3g} nats",
        flush=True,
    )


def totals(results: list[dict[str, Any]]) -> None:
    """False discoveries, coverage, speed."""
    errors = np.array([error for result in results for error in result["errors"]])
    inside = int((np.abs(errors) < 1.96).sum())
    found = sum(result["findings"] for result in results)
    print(f"{'false discoveries among findings':46} {interval(sum(r['false'] for r in results), found)}")
    sure = sum(result["sure_wrong"] for result in results)
    print(f"{'drives with a wrong name above 0.9':46} {interval(sure, len(results))}")
    print(f"{'95 % intervals that hold the truth':46} {interval(inside, len(errors))}")
    factor = float(np.median([result["factor"] for result in results]))
    print(f"{'times faster than real time, one core':46} {factor:.0f}")


if __name__ == "__main__":
    main()
