"""Result of the discovery, as records and as the JSON document.

In: nothing. Out: `BusDiscovery`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tpmsd.foundation.plain import brief
from tpmsd.offline.discovery.assign import Assignment
from tpmsd.offline.discovery.candidates import Candidate
from tpmsd.offline.discovery.series import MessageField
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard deviation."""

    value: float
    std: float

    def document(self) -> dict[str, float]:
        """Return the record as JSON has it."""
        return {"value": self.value, "std": self.std}


@dataclass(frozen=True, slots=True)
class FoundRole:
    """A signal and what it is."""

    role: str
    field: MessageField
    probability: float
    alternatives: tuple[tuple[str, float], ...] = ()
    modulus: int = 0
    """Number of values of a counter where it is not the field's width; 0 else."""
    unit: str | None = None
    """The unit that fits where the DBC's does not."""
    scale: float | None = None
    """The scale that fits where the DBC's does not."""
    sign: float = 1.0
    offset: float | None = None
    """The offset that goes with `scale`."""
    invalid: tuple[int, ...] = ()
    """Raw numbers that stand for no value and that the DBC does not declare."""

    @property
    def bus(self) -> int:
        """Number of the bus in the log."""
        return self.field.key >> BUS_SHIFT

    @property
    def is_plain(self) -> bool:
        """True if the DBC's entry is used as it is: no modulus, unit, scale, sign or invalid number of its
        own.
        """
        return (
            not self.modulus
            and self.unit is None
            and self.scale is None
            and self.sign > 0
            and not self.invalid
        )


@dataclass(frozen=True, slots=True)
class Undecided:
    """Question that this drive leaves open."""

    key: str
    why: str
    drive: str
    """Drive that would answer it."""

    def document(self) -> dict[str, str]:
        """Return the record as JSON has it."""
        return {"key": self.key, "why": self.why, "drive": self.drive}


@brief
@dataclass(frozen=True, slots=True)
class BusDiscovery:
    """Roles, counts per revolution, driven axle, geometry and receiver of a bus, with probabilities."""

    kind: str | None
    """counts | speeds; None if no wheels were found."""
    roles: dict[str, FoundRole] = field(default_factory=dict)
    counts_per_rev: Estimate | None = None
    counts_probability: float = 0.0
    counts_alternatives: tuple[tuple[float, float], ...] = ()
    """Other numbers and their probability."""
    contradictions: tuple[str, ...] = ()
    """Statements that were given and that the drive speaks against, a sentence each."""
    driven_axle: tuple[str, float] | None = None
    geometry: dict[str, Estimate] = field(default_factory=dict)
    gnss: dict[str, Estimate] = field(default_factory=dict)
    undecided: tuple[Undecided, ...] = ()
    assignment: Assignment | None = None
    car: str | None = None
    """The entry of the car library that fits."""
    candidates: tuple[Candidate, ...] = ()
    """Signals that may be a wheel where no wheels were found, the most probable first."""
    duration_s: float = 0.0
    frames: int = 0
    has_dbc: bool = True
    channels: tuple[str, ...] = ()
    """Names of the log's buses by number."""

    @property
    def main_bus(self) -> int:
        """Number of the bus that carries most wheels; of equals the first."""
        buses = [one.bus for role, one in self.roles.items() if role.startswith("wheel_")]
        return max(sorted(set(buses)), key=buses.count, default=0)

    def channel(self, bus: int) -> str:
        """Return the log's name of a bus, by its number."""
        return self.channels[bus] if bus < len(self.channels) else f"can{bus}"

    @property
    def wheels_decided(self) -> bool:
        """True if every wheel has its signal."""
        return self.kind is not None and not any(
            entry.key.startswith("can.signals.wheel") for entry in self.undecided
        )

    def document(self) -> dict[str, Any]:
        """Return the JSON document, without `schema`, `program` and `input`, which the command adds."""
        axle = self.driven_axle
        return {
            "roles": {
                role: {
                    "signal": found.field.signal,
                    "probability": found.probability,
                    **_alternatives_document(
                        [{"signal": name, "probability": p} for name, p in found.alternatives]
                    ),
                    **({"bus": self.channel(found.bus)} if len(self.channels) > 1 else {}),
                    **({"modulus": found.modulus} if found.modulus else {}),
                    **({"unit": found.unit} if found.unit else {}),
                    **({"scale": found.scale} if found.scale is not None else {}),
                    **({"invalid": list(found.invalid)} if found.invalid else {}),
                    **({"sign": found.sign} if found.sign < 0 else {}),
                }
                for role, found in self.roles.items()
            },
            "kind": self.kind,
            "counts_per_rev": None
            if self.counts_per_rev is None
            else {
                **self.counts_per_rev.document(),
                "probability": self.counts_probability,
                **_alternatives_document(
                    [{"value": value, "probability": p} for value, p in self.counts_alternatives]
                ),
            },
            "driven_axle": None if axle is None else {"value": axle[0], "probability": axle[1]},
            "geometry": {key: one.document() for key, one in self.geometry.items()},
            "gnss": {key: one.document() for key, one in self.gnss.items()},
            "candidates": [one.document() for one in self.candidates],
            "undecided": [one.document() for one in self.undecided],
            "contradictions": list(self.contradictions),
            "car": self.car,
            "duration_s": self.duration_s,
            "frames": self.frames,
        }


def _alternatives_document(entries: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Return the alternatives under their key, and under `rivals`, which readers of schema 1 know."""
    return {"alternatives": entries, "rivals": entries}
