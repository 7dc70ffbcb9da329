"""Reasons why an alarm is active and why none is: the posterior, the evidence, the alternatives.

In: every tick with its estimate, the monitor and its report. Out: a document of plain JSON types, for
`tpmsd explain`. Nothing here decides anything; what is kept is bounded.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tpmsd.car.config.model import MonitorConfig
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.gates.agreement import Agreement
from tpmsd.onboard.monitor.alarms.judge import ComparisonResult, Judgement
from tpmsd.onboard.monitor.baseline.baseline import Change
from tpmsd.onboard.monitor.evidence.contrasts import contrast_gains, contrast_rows
from tpmsd.onboard.monitor.evidence.posterior import Posterior
from tpmsd.onboard.monitor.evidence.sizes import TyreSizeChange, size_rows, subsets
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, MonitorReport
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, JUDGE
from tpmsd.onboard.resonance.evidence import ResonanceEvidence
from tpmsd.onboard.timeline.tick import Tick


@dataclass(frozen=True, slots=True)
class ExplanationSettings:
    """Settings of what is kept so that an alarm can be explained."""

    keep_every_s: float = 10.0
    """Driving time between two moments that are kept, s."""
    kept: int = 60
    """Moments: the last ten minutes."""
    kept_alarms: int = 16
    """Alarms whose moments are kept: what a workshop may ask for, in bounded memory."""
    around: int = 12
    """Moments that are kept with an alarm."""
    best: int = 6
    """Alternatives that are listed."""
    recent_s: float = 60.0
    """Time constant of the shares of driving."""
    moving_mps: float = 2.0
    """Speed from which the car moves."""


EXPLANATION = ExplanationSettings()


@dataclass(frozen=True, slots=True)
class _JudgementRecord:
    """A judgement and what it was made from; put into words only when somebody asks."""

    time_s: float
    estimate: RadiusEstimate
    change: Change
    finding: ComparisonResult
    judgement: Judgement
    resonance: ResonanceEvidence | None


class Explanation:
    """Record of the evidence of one monitor."""

    def __init__(self, wheels: Sequence[int], settings: MonitorConfig) -> None:
        """`wheels`: indices of the monitored ones."""
        self._wheels = list(wheels)
        self._settings = settings
        self._moments: deque[dict[str, Any]] = deque(maxlen=EXPLANATION.kept)
        self._alarms: deque[dict[str, Any]] = deque(maxlen=EXPLANATION.kept_alarms)
        self._latest: Judgement | None = None
        self._judged: _JudgementRecord | None = None
        self._cached: tuple[_JudgementRecord, dict[str, Any]] | None = None
        """The last judgement that was put into words."""
        self._kept_s = -math.inf
        self._time_s = math.nan
        self._moving = self._taught = 0.0
        self._gnss_age_s = math.inf
        self._agreement: Agreement | None = None
        self._report: MonitorReport | None = None

    def update(
        self,
        tick: Tick,
        estimate: RadiusEstimate,
        agreement: Agreement,
        resonance: ResonanceEvidence | None,
        judgement: Judgement,
        report: MonitorReport,
    ) -> None:
        """Add a tick with all that the monitor was given, its present judgement, and its report."""
        share = 1.0 - math.exp(-tick.dt_s / EXPLANATION.recent_s)
        self._moving += share * (float(estimate.speed_mps > EXPLANATION.moving_mps) - self._moving)
        self._taught += share * (float(estimate.informative) - self._taught)
        self._time_s, self._gnss_age_s, self._agreement = tick.host_time_s, estimate.gnss_age_s, agreement
        self._report = report
        if judgement is not self._latest:
            self._latest = judgement
            self._keep_judgement(estimate, judgement, resonance)
        for event in report.events:
            self._keep_alarm(event)

    def _keep_judgement(
        self, estimate: RadiusEstimate, judgement: Judgement, resonance: ResonanceEvidence | None
    ) -> None:
        """Keep the last judgement of the wheels, and from time to time its document entry."""
        if judgement.now is None or judgement.finding is None:
            return
        self._judged = _JudgementRecord(
            self._time_s, estimate, judgement.now, judgement.finding, judgement, resonance
        )
        if abs(self._time_s - self._kept_s) >= EXPLANATION.keep_every_s:
            self._kept_s = self._time_s
            self._moments.append(self._moment_entry(self._judged))

    def _keep_alarm(self, event: AlarmEvent) -> None:
        """Keep the evidence of an alarm that was raised or cleared."""
        evidence = list(self._moments)[-EXPLANATION.around :]
        before = None
        if self._judged is not None:
            latest = self._moment_entry(self._judged)
            if not evidence or evidence[-1] is not latest:
                evidence.append(latest)
            if event.wheel in latest["wheels"]:
                before = latest["wheels"][event.wheel]["before_mm"]
        self._alarms.append(
            {
                "time": _finite_or_none(event.time_s),
                "kind": str(event.kind),
                "wheel": event.wheel,
                "state": event.state,
                "reason": event.reason,
                "probability": _finite_or_none(event.probability),
                **event.additional_keys(),
                "before_mm": before,
                "evidence": evidence,
                "alternatives": self._alternatives(),
                "clears_when": self._clearing_condition(event)
                if event.state == "raised"
                else "it is cleared",
            }
        )

    def _clearing_condition(self, event: AlarmEvent) -> str:
        """Return the condition under which an alarm is cleared, in words."""
        if event.kind is AlarmKind.MALFUNCTION:
            return "the signals have been in order for a tenth of the time that raised it"
        if event.kind is AlarmKind.SLOW_LEAK:
            return "a week of drives fits no leak better than this leak, or when other tyres are driven"
        at, hold_s = self._settings.clear_probability, self._settings.clear_hold_s
        of = "that it differs from the other wheel of its axle as no set does" if event.since else "of it"
        return (
            f"the probability {of} is at most {at:g} for {hold_s:g} s of informative driving "
            f"(it was {event.probability:.3f}), or a reset is accepted"
        )

    def document(self, monitor: Monitor) -> dict[str, Any]:
        """Return the explanation in JSON's types; `monitor`: the one that is explained."""
        states = {WHEELS[w]: "unavailable" for w in self._wheels}
        report, sets = self._report, monitor.sets
        if report is not None:
            states |= {wheel.wheel: str(wheel.state) for wheel in report.wheels if wheel.wheel in states}
        active = () if report is None else report.active
        baseline = sets.baseline
        missing = [alarm.reason for alarm in active if alarm.kind is AlarmKind.MALFUNCTION]
        if not baseline.ready:
            missing.append(
                f"learning: {100 * baseline.fraction:.0f} % of the first baseline; before it "
                "no loss is seen, but a tyre that is soft already"
            )
        if sets.undecided:
            missing.append("learning: a reset waits for its baseline; the one before it judges")
        learning = {
            "fraction": round(baseline.fraction, 4),
            "learned_s": round(baseline.learned_s, 1),
            "tyres": sets.name,
            "settled": baseline.settled,
        }
        wheels: dict[str, Any] = {}
        for wheel in self._wheels:
            name = WHEELS[wheel]
            wheels[name] = {
                "state": states[name],
                **self._wheel_entry(wheel, sets.comparison_baseline.origin),
            }
        return {
            "time": _finite_or_none(self._time_s),
            "alarms": list(self._alarms),
            "wheels": wheels,
            "alternatives": self._alternatives(),
            "would_change": self._decisive_conditions(),
            "evidence": list(self._moments),
            "missing": {
                "motion": {
                    "moving_share": round(self._moving, 3),
                    "teaching_share": round(self._taught, 3),  # the former name of the next one
                    "informative_fraction": round(self._taught, 3),
                },
                "sky": {
                    "gnss_age_s": _finite_or_none(self._gnss_age_s),
                    "agrees": None if self._agreement is None else not self._agreement.withheld,
                },
                "learning": learning,
            },
            "why_no_alarm": [*missing, *self._no_alarm_reasons()],
        }

    def _no_alarm_reasons(self) -> list[str]:
        """Return the reasons for which no tyre is judged now, in words."""
        out = []
        if self._moving < 0.05:
            out.append(
                "motion: the car has hardly moved in the last minute; nothing is judged at a standstill"
            )
        elif self._taught < 0.2:
            out.append(
                f"motion: {100 * self._taught:.0f} % of the last minute taught (above 6 m/s, gentle); "
                "the rest is not judged"
            )
        if self._gnss_age_s > 10.0:
            out.append(
                "sky: no fix is used now; wheels are compared with each other, all four together are not"
            )
        if self._agreement is not None and self._agreement.withheld:
            out.append("sky: wheels and receiver disagree; no tyre is judged until they agree again")
        if self._agreement is not None and self._agreement.unsteady:
            out.append("bus: the wheels' readings jump; no tyre is judged")
        models = {} if self._judged is None else self._judged.judgement.drive_models
        out += [
            f"drive: {model.name} (probability {models[model.name]:.2f}) explains what differs; {model.hides}"
            for model in DRIVE_EVIDENCE.models
            if model.hides and models.get(model.name, 0.0) >= JUDGE.undecided
        ]
        return out

    def _wheel_entry(self, wheel: int, origin: str) -> dict[str, Any]:
        """Return the entry of a wheel; `origin`: source of the radii that its change is counted from."""
        if self._judged is None:
            return {"why_no_alarm": "nothing was judged yet"}
        judged, now = self._judged.judgement, self._moment_entry(self._judged)["wheels"][WHEELS[wheel]]
        change_mm, std_mm = 1e3 * float(judged.change_m[wheel]), 1e3 * float(judged.change_std_m[wheel])
        detectable = judged.detectable
        smallest = math.nan if detectable is None else detectable.each_m[self._wheels.index(wheel)]
        return {
            **now,
            "smallest_loss_seen_mm": _mm(smallest),
            "why_no_alarm": (
                f"changed by {change_mm:+.2f} +- {std_mm:.2f} mm since {origin}; "
                f"it has lost air with probability {float(judged.deflated[wheel]):.3f}"
            ),
        }

    def _moment_entry(self, judged: _JudgementRecord) -> dict[str, Any]:
        """Return the document entry of a judgement, cached for the last one."""
        if self._cached is None or self._cached[0] is not judged:
            self._cached = (judged, self._evidence_entry(judged))
        return self._cached[1]

    def _evidence_entry(self, judged: _JudgementRecord) -> dict[str, Any]:
        """Return the document entry of a judgement."""
        estimate, judgement, change, resonance = (
            judged.estimate,
            judged.judgement,
            judged.change,
            judged.resonance,
        )
        wheels = {}
        for wheel in self._wheels:
            deviation, moved = float(estimate.deviation_m[wheel]), float(judgement.change_m[wheel])
            wheels[WHEELS[wheel]] = {
                "before_mm": _mm(deviation - moved),
                "now_mm": _mm(deviation),
                "now_std_mm": _mm(math.sqrt(max(float(estimate.covariance_m2[wheel, wheel]), 0.0))),
                "change_mm": _mm(moved),
                "change_std_mm": _mm(float(judgement.change_std_m[wheel])),
                "probability": _finite_or_none(float(judgement.deflated[wheel])),
            }
        finding, rows = judged.finding, contrast_rows(self._wheels)
        adds = contrast_gains(rows, finding.change_m, finding.covariance_m2, -finding.verdict.best_loss_m)
        contrast_changes = {
            name: {
                "change_mm": _mm(float(row @ change.change_m)),
                "std_mm": _mm(_contrast_std(row, change.covariance_m2)),
                "gain_nats": _finite_or_none(adds[name]),
            }
            for name, row in rows.items()
        }
        received = None
        if resonance is not None and resonance.wheels:
            received = {
                WHEELS[w]: round(float(resonance.log_ratio([w])), 3)
                for w in self._wheels
                if w in resonance.wheels
            }
        by_source = {**contrast_changes, "resonance_log_ratio": received}
        return {
            "time": _finite_or_none(judged.time_s),
            "speed_mps": _finite_or_none(estimate.speed_mps),
            "wheels": wheels,
            "witnesses": by_source,  # the former name of `evidence_by_source`
            "evidence_by_source": by_source,
            "judged_over": finding.over,
            "drive_models": {
                name: _finite_or_none(probability) for name, probability in judgement.drive_models.items()
            },
        }

    def _alternatives(self) -> list[dict[str, Any]]:
        """Return the hypotheses by descending probability, each with the reason why it was not chosen."""
        if self._judged is None:
            return []
        bank = self._judged.judgement.posterior
        assert bank is not None
        gains = self._judged.finding.verdict.gains
        entries: list[dict[str, Any]] = [
            {"what": "no tyre has changed", "wheels": [], "probability": bank.none, "gain_nats": 0.0}
        ]
        for index, members in enumerate(subsets(len(self._wheels))):
            names = [WHEELS[self._wheels[k]] for k in members]
            entries.append(
                {
                    "what": f"{' '.join(names)} lost radius",
                    "wheels": names,
                    "probability": float(bank.subsets[index]),
                    "gain_nats": round(float(gains[index]), 3),
                    "prior": JUDGE.prior_by_size[len(members) - 1],
                }
            )
        entries += self._size_alternatives(bank)
        entries.sort(key=lambda entry: -float(entry["probability"]))
        best = entries[0]
        leading = max(float(best["probability"]), 1e-300)
        for entry in entries:
            entry["nats_to_lead"] = round(math.log(leading / max(float(entry["probability"]), 1e-300)), 3)
            behind = float(best["gain_nats"]) - float(entry["gain_nats"])
            entry["probability"] = round(float(entry["probability"]), 6)
            if entry is best:
                entry["why"] = "the most probable"
            elif behind > 1.0:
                entry["why"] = f"fits worse by {behind:.1f} nats"
            else:
                entry["why"] = "fits as well, and is less probable beforehand"
        return entries[: EXPLANATION.best]

    def _decisive_conditions(self) -> list[str]:
        """Return the conditions, in words, under which another hypothesis becomes the most probable, or a
        suspicion an alarm."""
        if self._judged is None or self._judged.judgement.posterior is None:
            return []
        judgement, bank = self._judged.judgement, self._judged.judgement.posterior
        lead = self._alternatives()[:2]
        out = [f"{lead[1]['what']}: evidence of {lead[1]['nats_to_lead']:.1f} nats more for it"]
        probability = float(np.nan_to_num(judgement.deflated).max())
        if self._settings.clear_probability < probability < self._settings.raise_probability:
            short = _logit(self._settings.raise_probability) - _logit(probability)
            out.append(f"an alarm: evidence of {short:.1f} nats more for a loss")
        if not judgement.drive_models:
            out.append(
                "more driving: what both tyres of an axle or all four do is judged by the drive as a whole"
            )
        loaded = sum(judgement.drive_models.get(name, 0.0) for name in DRIVE_EVIDENCE.load_models)
        if loaded > self._settings.clear_probability:
            out.append("a drive with the usual load and no trailer: what is left then is the tyres'")
        if judgement.slippery > self._settings.clear_probability:
            out.append("a drive on a dry road: driven wheels slip on this one")
        if float(bank.sizes[1:].sum()) > self._settings.clear_probability:
            out.append("other tyres: tpmsd reset --tyres NAME says that they are")
        return out

    def _size_alternatives(self, bank: Posterior) -> list[dict[str, Any]]:
        """Return the entries of larger tyres and of wheels changed front to rear; a tyre may have lost air
        as well."""
        sizes = size_rows(tuple(self._wheels))
        out = []
        for row in range(1, len(bank.sizes)):  # none while a set is learned beside another
            names = [WHEELS[self._wheels[k]] for k in np.flatnonzero(sizes.pattern[row])]
            larger = sizes.mean[row] > 0.0
            out.append(
                {
                    "what": f"{' '.join(names)} of another size"
                    if larger
                    else "wheels changed front to rear",
                    "wheels": names,
                    "probability": float(bank.sizes[row]),
                    "gain_nats": round(_log_bayes_factor(bank, sizes, row), 3),
                    "prior": JUDGE.prior_resized,
                }
            )
        return out


def _log_bayes_factor(bank: Posterior, sizes: TyreSizeChange, row: int) -> float:
    """Return the log of the evidence for a row of sizes against all wheels of the size that was learned,
    nats."""
    chances = np.maximum(bank.sizes, 1e-300)
    return float(np.log(chances[row] / chances[0]) - sizes.log_prior[row] + sizes.log_prior[0])


def _logit(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def _contrast_std(row: FloatArray, covariance: FloatArray) -> float:
    """Return the standard deviation of row @ x for x of this covariance."""
    return math.sqrt(max(float(row @ covariance @ row), 0.0))


def _finite_or_none(value: float) -> float | None:
    """Return the number; None if it is not finite."""
    return round(float(value), 6) if math.isfinite(value) else None


def _mm(value_m: float) -> float | None:
    """Return metres as millimetres; None if not finite."""
    return round(1e3 * float(value_m), 4) if math.isfinite(value_m) else None
