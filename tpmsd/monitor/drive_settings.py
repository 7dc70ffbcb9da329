"""The settings of what a drive as a whole says (a part of `settings`).

In: nothing. Out: `DriveModel`, `DriveEvidenceSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DriveModel:
    """What may make the radii of a whole drive others than learned while no tyre is at fault; standard
    deviations beside those of `ReferenceSettings`, relative to the radius."""

    name: str
    prior: float
    """Probability beforehand, of one drive."""
    hides: str = ""
    """What of a loss it hides, for people."""
    load_std: tuple[float, float] = (0.0, 0.0)
    """Load of the front and of the rear axle."""
    drag_std: float = 0.0
    """Slip of the driven axles by drag, per `per_speed2`."""
    hill_std: float = 0.0
    """Slip of the driven axles on slopes, per m/s2."""
    slip_std: float = 0.0
    """Slip of each driven axle, all drive long."""
    pull_std: float = 0.0
    """Slip of each driven axle at a moment of which it is not known how hard the car pulls."""
    axle_scatter: float = 0.0
    """Slip of each driven axle that comes and goes between samples, ..."""
    own_scatter: float = 0.0
    """... and of each wheel."""


@dataclass(frozen=True, slots=True)
class DriveEvidenceSettings:
    """A drive as a whole (`drive_evidence`)."""

    models: tuple[DriveModel, ...] = (
        DriveModel("as learned", 0.87),
        DriveModel(
            "another load",
            0.08,
            "two tyres of an axle that were soft at its beginning are not seen",
            load_std=(6e-4, 1.75e-3),
        ),
        DriveModel(
            "a trailer",
            0.02,
            "two tyres of an axle that were soft at its beginning are not seen",
            load_std=(6e-4, 1.75e-3),
            drag_std=1.6e-3,
            hill_std=4e-3,
        ),
        DriveModel(
            "low grip",
            0.02,
            "driven wheels slip, and say little of their radii",
            load_std=(6e-4, 3e-3),
            drag_std=1.6e-3,
            hill_std=1e-2,
            slip_std=5e-3,
            pull_std=2.5e-2,
            axle_scatter=3e-3,
            own_scatter=1e-3,
        ),
        DriveModel(
            "loose ground",
            0.01,
            "every wheel slips, spins or locks for itself; a soft tyre shows in the mean of many minutes",
            load_std=(6e-4, 3e-3),
            drag_std=1.6e-3,
            hill_std=1e-2,
            slip_std=5e-3,
            pull_std=2.5e-2,
            axle_scatter=5e-3,
            own_scatter=5e-3,
        ),
    )
    """A full van lowers its rear tyres by 0.9 mm (3 kN a wheel, 0.25 mm per 500 N of a tyre of 1.6 times the
    stiffness), a full compact by 0.8 mm; of loads drawn evenly from none to full the root mean square is 0.58
    of that, 0.54 mm. A trailer's drag area of 1.2 m2 doubles or trebles the drag slip of `physics.priors`,
    and its mass the slip on slopes. A front axle that carries half of a car slips by 2.5 % at 1 m/s2 with 0.4
    of the dry stiffness (21 per unit of force over load: `longitudinal_slip`). On ice and gravel driven
    wheels slip by 2 to 3 mm. Shares of drives: assumed."""
    slipping: tuple[str, ...] = ("low grip", "loose ground")
    """Those in which driven wheels slip."""
    estimate_share: float = 2.0
    """Variance of the mean of estimates 20 s apart relative to independent ones: their memory is 4 to 40 s,
    which makes 1.0 to 4.1."""
    lasting_share: float = 0.1
    """Of the variance of what comes and goes by side and by wheel: so much lasts all drive long (crown of the
    road, wind)."""
    kept: int = 12
    """Onsets in doubt of each shape, besides the start and the last ones; the likeliest are kept."""
    start_prior: float = 0.5
    """That a tyre which lost air had lost it when the drive began; else any onset is as likely."""
    least_std: float = 1e-9
    """Keeps the information of an onset from being singular, relative to its largest part."""
