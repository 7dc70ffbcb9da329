"""Effects concealed by worlds that import nothing of the program: sealed, diagnosed, opened, scored.

    make proof                             six drives, and recordings where they are at hand
    python -m bench run proof --seed 7     other effects, other cars, other roads

Out: a table in the terminal and PAGE. Exit code 1 where a name is wrong. The truth of every drive is written
first and its SHA-256 printed; a process of its own then diagnoses the drive's folder, and only then is the
truth read. The origin `receiver` draws from errors of recorded receivers; without recordings `kinematic`
stands in its place. An `oracle` says which of the effects are identifiable on their drives:
these must be named first.
PySINDy and gplearn are given the same folders (`pip install -e '.[proof]'`).
"""

from __future__ import annotations

import argparse
import concurrent.futures
import itertools
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.offline.diagnosis.draw import EFFECTS, Case, draw_case
from bench.campaigns.offline.diagnosis.make import Made, make
from bench.campaigns.offline.diagnosis.score import match, score
from bench.campaigns.offline.diagnosis.seal import Answer, asked
from bench.campaigns.offline.diagnosis.truth import Concealed, Truth, truth_of
from bench.campaigns.offline.proof.oracle import are_identifiable, bounds
from bench.campaigns.offline.proof.others import Said, others
from bench.campaigns.offline.proof.page import headline, page
from bench.campaigns.offline.proof.seal import Seal, opened, seal
from bench.places import OUT, RECORDINGS, REPO
from bench.worlds import real_drives, receiver_residuals
from bench.worlds.folder import write_folder

ORIGINS = ("kinematic", "receiver", "mems", "latched")
"""Worlds that need no package beyond the program's own."""
DRIVES = 6
LAP_S = 100.0
"""Of the car on the race track: hard driving in several bends."""
SURE = 0.9
"""Confidence above which a wrong name is wrong whatever stands beside it."""
TYRES = frozenset(
    {"cornering_stiffness_error", "tyre_relaxation", "tyre_saturation", "load_dependent_stiffness"}
)


@dataclass
class Row:
    """A line of the table."""

    drive: str
    concealed: str
    truth: str = ""
    inherent: str = ""
    """What the drive's world holds besides, with its size: a true finding that is not asked for."""
    located: str = ""
    named: str = ""
    value: str = ""
    residual: str = ""
    hit: bool = False
    wrong: bool = False
    known: bool = False
    """A recording, of which one name is known and other names are not judged; it does not count."""
    identifiable: bool = True
    """By the oracle."""
    oracle: str = ""
    said: str = ""
    """The diagnosis's own first sentences."""
    picture: str = ""
    """SVG of the residual before and after."""
    sha256: str = ""
    file: str = ""
    """The opened truth beside the page, with this SHA-256."""
    others: dict[str, str] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """Hit, miss, wrong name, or not identifiable."""
        if self.wrong:
            return "WRONG NAME"
        if self.known:
            return "found" if self.hit else "not found"
        if self.hit:
            return "hit" if self.identifiable else "hit (beyond what the oracle asks)"
        return "miss" if self.identifiable else "miss (not identifiable on this drive)"


def drawn(seed: int, recordings: Path) -> list[Case]:
    """Return the cases: distinct effects of the public table at strength 1, and a null drive.

    Without all of `receiver_residuals.DEVELOPMENT` in the folder `recordings`, `kinematic` takes the place of
    the origin `receiver`; all else is drawn alike."""
    at_hand = all((recordings / name).is_dir() for name in receiver_residuals.DEVELOPMENT)
    rng = np.random.default_rng([seed, 45])
    effects = rng.choice(EFFECTS, DRIVES - 1, replace=False)
    kinds = rng.permutation(["nothing", *effects])
    worlds = rng.choice(ORIGINS, DRIVES)
    cases = []
    for kind, world, at in zip(kinds, worlds, rng.integers(1, 50_000, DRIVES), strict=True):
        plain = world == "kinematic" or (world == "receiver" and not at_hand)
        name = str(kind) if plain else f"{world}/{kind}"
        cases.append(draw_case(name, 0.0 if kind == "nothing" else 1.0, int(at)))
    return cases


def whole_truth(case: Case, made: Made) -> Truth:
    """Return what is sealed: the concealed effect, and a drawn receiver's velocity lag.

    The lag is a true finding that is not asked for."""
    truth = truth_of(case, made.windows)
    lag_s = case.spec.doppler_age_s
    if lag_s > 0.0:
        spans = [[0.0, float(truth.driving_s)]]
        channels = ["gnss_speed", "gnss_course"]
        truth.effects.append(
            Concealed(
                "velocity_lag",
                "velocity_lag",
                {"lag_s": lag_s},
                0.0,
                0.0,
                "",
                [],
                channels,
                ["time"],
                spans,
                True,
            )
        )
    return truth


def numbers(findings: Sequence[dict[str, Any]]) -> str:
    """The fitted values of findings, with half of their 95 % intervals."""
    parts = []
    for finding in findings:
        for name, each in finding["parameters"].items():
            value, std = each["value"], each["std"]
            if isinstance(value, float) and std is not None:
                parts.append(f"{name} {value:.4g} +- {float(f'{1.96 * std:.1g}'):g}")
            else:
                parts.append(f"{name} {value}")
    return ", ".join(parts)


def measured(document: dict[str, Any]) -> str:
    """Held-out residual before and after, in expected sizes."""
    before, after = document["baseline"]["heldout_rms"], document["model"]["heldout_rms"]
    return f"{before:.3f} to {after:.3f}"


def places(findings: Sequence[dict[str, Any]]) -> str:
    """Where findings lie."""
    return "; ".join(
        f"{' '.join(each['where'].get('wheels') or []) or each['where']['channel']} over"
        f" {each['where']['covariate']}"
        for each in findings
    )


def names_of(findings: Sequence[dict[str, Any]]) -> str:
    """Names and confidences of the findings."""
    return ", ".join(f"{each['effect']} {each['confidence']:.2f}" for each in findings) or "nothing"


def listed(parameters: Mapping[str, Any]) -> str:
    """Names and values of a truth's parameters."""
    return ", ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in parameters.items()
    )


def held_besides(truth: Truth) -> str:
    """Names and values of what the drive's world holds without having been asked to."""
    return "; ".join(f"{each.effect} {listed(each.parameters)}" for each in truth.effects if each.inherent)


def scored(case: Case, made: Made, truth: Truth, answer: Answer, said: dict[str, Said], sha256: str) -> Row:
    """Return the row of a drive whose truth was opened."""
    wanted = [each for each in truth.effects if not each.inherent]
    row = Row(case.world, ", ".join(each.effect for each in wanted) or "nothing", sha256=sha256)
    row.truth = listed({name: value for each in wanted for name, value in each.parameters.items()})
    row.inherent = held_besides(truth)
    row.identifiable, row.oracle = are_identifiable(wanted), bounds(wanted)
    if answer.error or answer.document.get("reason"):
        row.named = answer.error or str(answer.document["reason"])
        return row
    joined = score(case, truth, answer.document, answer.model, made.windows)
    findings = answer.document["findings"]
    matched = match(truth, findings)
    row.named, row.said = names_of(findings), str(answer.document.get("summary", ""))
    row.located, row.value, row.residual = places(findings), numbers(findings), measured(answer.document)
    inherent = {k for k, each in enumerate(truth.effects) if each.inherent}
    own = [k for k in matched if k not in inherent]
    row.wrong = any(wrong(findings[n], wanted) for n in joined["strays"])
    row.hit = not row.wrong and (not wanted or (bool(own) and own[0] is not None))
    row.others = {name: compared(one, wanted) for name, one in said.items()}
    return row


def wrong(finding: Mapping[str, Any], wanted: Sequence[Concealed]) -> bool:
    """Return True for a finding that the drive does not hold, unless it is unsure of its name and lists a
    concealed effect among those that the drive cannot distinguish from it.
    """
    listed_too = {each.effect for each in wanted} & set(finding["indistinguishable_from"])
    return finding["confidence"] > SURE or not listed_too


def compared(said: Said, wanted: Sequence[Concealed]) -> str:
    """Return the answer of another method, and whether it is where an effect acts."""
    if said.error:
        return said.error
    found = any(said.locates(each.channels, each.wheels, each.covariates) for each in wanted)
    judged = "located" if found else "not located"
    return f"{judged}: {said.residual} = {said.formula} ({100 * said.explained:.0f} % explained)"


@dataclass(frozen=True)
class World:
    """A drive of a world: its case, what was made, its folder and its sealed truth."""

    case: Case
    made: Made
    drive: Path
    sealed: Seal


@dataclass(frozen=True)
class Recording:
    """A recording of which a name is known, or into which an effect was injected under seal."""

    name: str
    concealed: str
    drive: Path
    right: frozenset[str]
    """Names of effects that answer it."""
    options: tuple[str, ...] = ("--certify", "0")
    sealed: Seal | None = None


def worlds(seed: int, folder: Path) -> list[World]:
    """Make the drives of a seed and seal their truths; each hash is printed at once."""
    made_drives = []
    nonce = np.random.default_rng([seed, 46])
    for number, case in enumerate(drawn(seed, RECORDINGS), 1):
        made, drive = make(case, folder / "memory"), folder / f"drive-{number}"
        write_folder(made.drive, drive)
        truth = whole_truth(case, made).plain()
        sealed = seal(truth, nonce.bytes(16).hex(), folder / f"sealed-{number}.json")
        print(f"drive {number} ({case.world}): truth sealed, SHA-256 {sealed.sha256}", flush=True)
        made_drives.append(World(case, made, drive, sealed))
    return made_drives


def recordings(seed: int, folder: Path) -> list[Recording]:
    """Return the recordings that are at hand; into one of them an effect is injected and sealed."""
    at_hand = []
    for name in ("van-mountain-a", "van-mountain-b"):
        drive = RECORDINGS / name
        if drive.is_dir():
            at_hand.append(
                Recording(name, "road_grade (a mountain road)", drive.resolve(), frozenset({"road_grade"}))
            )
    signals = RECORDINGS.parent / "dynamics" / "ferrari-250lm"
    if signals.is_dir():
        options = ("--baseline", "single-track")
        piece = begun(signals, folder / signals.name)
        at_hand.append(Recording(signals.name, "tyres on the limit", piece, TYRES, options))
    source = RECORDINGS / "van-motorway-a"
    if source.is_dir():
        rng = np.random.default_rng([seed, 47])
        effect = str(rng.choice(("centrifugal_growth", "gnss_latency", "radius_change")))
        target = folder / "injected"
        real_drives.cut(source, target, rng)
        sealed = seal(real_drives.inject(target, effect, rng), rng.bytes(16).hex(), folder / "sealed-i.json")
        print(f"van-motorway-a: an effect injected and sealed, SHA-256 {sealed.sha256}", flush=True)
        names = frozenset({effect})
        at_hand.append(Recording(source.name, f"{effect} (injected)", target, names, sealed=sealed))
    return at_hand


def begun(signals: Path, folder: Path) -> Path:
    """Copy the first `LAP_S` of a drive of vehicle dynamics, as much as is diagnosed in half a minute."""
    folder.mkdir()
    shutil.copy(signals / "vehicle.toml", folder)
    with (signals / "signals.csv").open(encoding="utf-8") as whole:
        head = next(whole)
        rows = itertools.takewhile(lambda row: float(row.partition(",")[0]) < LAP_S, whole)
        (folder / "signals.csv").write_text(head + "".join(rows), encoding="utf-8")
    return folder


def answered(
    drive: Path, picture: Path, seed: int, with_others: bool, options: tuple[str, ...] = ("--certify", "0")
) -> tuple[Answer, dict[str, Said]]:
    """Return what the diagnosis and the other methods say of a folder; they are given nothing else."""
    drawn_too = ("--plot", str(picture)) if find_spec("matplotlib") else ()
    answer = asked(drive, REPO, *options, *drawn_too)
    return answer, others(drive, seed) if with_others else {}


def all_answers(
    made: Sequence[World], at_hand: Sequence[Recording], folder: Path, args: argparse.Namespace
) -> list[tuple[Answer, dict[str, Said]]]:
    """Return the answers to worlds, then to recordings, in order, with progress on standard error.

    Recordings are begun first, since they are longer: so no core waits for the last of them."""
    begun, with_others = time.monotonic(), not args.no_others
    with concurrent.futures.ProcessPoolExecutor(args.jobs) as pool:
        of_recordings = [
            pool.submit(answered, one.drive, picture_of(one, folder), args.seed, False, one.options)
            for one in at_hand
        ]
        of_worlds = [
            pool.submit(answered, one.drive, picture_of(one, folder), args.seed, with_others) for one in made
        ]
        work = [*of_worlds, *of_recordings]
        for done, one in enumerate(concurrent.futures.as_completed(work), 1):
            one.result()
            print(
                f"diagnosed: {done} of {len(work)} drives, {time.monotonic() - begun:.0f} s",
                file=sys.stderr,
                flush=True,
            )
        return [one.result() for one in work]


def picture_of(one: World | Recording, folder: Path) -> Path:
    """Where the residual's picture of a drive is written."""
    name = one.name if isinstance(one, Recording) else one.drive.name
    return folder / f"{name}.svg"


def known(one: Recording, answer: Answer) -> Row:
    """Return the row of a recording of which a name is known; other findings are not judged."""
    row = Row(one.name, one.concealed, truth="not known in number", known=True)
    if one.sealed is not None:
        row.truth, row.sha256 = listed(opened(one.sealed)), one.sealed.sha256
    if answer.error or answer.document.get("reason"):
        row.named = answer.error or str(answer.document["reason"])
        return row
    document = answer.document
    findings = document["findings"]
    row.named, row.said = names_of(findings), str(document.get("summary", ""))
    row.hit = any(each["effect"] in one.right for each in findings)
    of_interest = [each for each in findings if each["effect"] in one.right]
    row.located, row.value = places(of_interest), numbers(of_interest)
    if outputs := document.get("outputs"):
        row.residual = ", ".join(
            f"{name} {each['rms_before']:.3g} to {each['rms_after']:.3g} {each['unit']}"
            for name, each in outputs.items()
        )
    elif "heldout_rms" in document.get("baseline", {}) and "heldout_rms" in document.get("model", {}):
        row.residual = measured(document)
    return row


def proven(seed: int, folder: Path, args: argparse.Namespace) -> list[Row]:
    """Seal all truths, diagnose all drives, then open and score."""
    made = worlds(seed, folder)
    at_hand = [] if args.no_recordings else recordings(seed, folder)
    answers = all_answers(made, at_hand, folder, args)
    rows = [
        scored(one.case, one.made, Truth.of(opened(one.sealed)), answer, said, one.sealed.sha256)
        for one, (answer, said) in zip(made, answers[: len(made)], strict=True)
    ]
    rows += [known(one, answer) for one, (answer, _) in zip(at_hand, answers[len(made) :], strict=True)]
    pictures = [picture_of(each, folder) for each in (*made, *at_hand)]
    args.page.parent.mkdir(parents=True, exist_ok=True)
    for number, (row, one) in enumerate(zip(rows, [*made, *at_hand], strict=True), 1):
        if one.sealed is not None:
            row.file = f"truth-{number}.json"
            shutil.copy(one.sealed.file, args.page.parent / row.file)
    for row, picture in zip(rows, pictures, strict=True):
        row.picture = picture.read_text(encoding="utf-8") if picture.exists() else ""
    return rows


def printed(rows: Sequence[Row]) -> str:
    """The table for the terminal."""
    lines = []
    for number, row in enumerate(rows, 1):
        lines.append(f"\n{number}. {row.drive}: {row.concealed} -> {row.verdict}")
        for title, text in (
            ("truth", row.truth),
            ("held besides", row.inherent),
            ("oracle", row.oracle),
            ("named", row.named),
            ("located", row.located),
            ("value, 95 %", row.value),
            ("held-out residual", row.residual),
            *row.others.items(),
        ):
            if text:
                lines.append(f"   {title + ':':20}{text}")
    lines.append(f"\nDrives of other programs: {headline(rows)}.")
    for method in dict.fromkeys(name for row in rows for name in row.others):
        asked_of = [row for row in rows if method in row.others and row.concealed != "nothing"]
        located = sum(row.others[method].startswith("located") for row in asked_of)
        lines.append(
            f"{method}: {located} of {len(asked_of)} located (residual and covariate are among those of the"
            " effect); it has no names."
        )
    return "\n".join(lines)


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--seed", type=int, default=1, help="draws effects, cars, roads and receivers (1)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument("--no-recordings", action="store_true", help="worlds alone")
    parser.add_argument("--no-others", action="store_true", help="leave the other methods out")
    parser.add_argument("--page", type=Path, default=OUT / "proof" / "index.html")


def main(args: argparse.Namespace) -> int:
    """Run and print; 1 where a name is wrong."""
    folder = Path(tempfile.mkdtemp(prefix="proof-"))
    try:
        rows = proven(args.seed, folder, args)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print(printed(rows))
    args.page.write_text(page(rows, args.seed), encoding="utf-8")
    print(f"Page: {args.page}")
    return 1 if any(row.wrong for row in rows) else 0
