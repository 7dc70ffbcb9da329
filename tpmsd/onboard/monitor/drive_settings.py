"""The settings of what a drive as a whole says (a part of `settings`).

In: nothing. Out: `DriveModel`, `DriveEvidenceSettings`, `SlipSlopeSettings`, `LevelSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DriveModel:
    """Reason why the radii of a whole drive differ from those learned while no tyre is at fault; standard
    deviations beside those of `ReferenceSettings`, relative to the radius.
    """

    name: str
    prior: float
    """Probability beforehand, of one drive."""
    hides: str = ""
    """Part of a loss that it hides, in words."""
    load_std: tuple[float, float] = (0.0, 0.0)
    """Load of the front and of the rear axle."""
    drag_std: float = 0.0
    """Slip of the driven axles by drag, per `per_speed2`."""
    slip_slope_std: float = 0.0
    """Slip of the driven axles on slopes, per m/s2."""
    slip_slope_times: tuple[float, float] = (1.0, 0.0)
    """Factor on the learned slip on slopes and per acceleration, with its standard deviation; ..."""
    drag_times: tuple[float, float] = (1.0, 0.0)
    """... the same of the slip by drag."""
    slip_std: float = 0.0
    """Slip of the driven axle, all drive long; of two each takes half of the force."""
    axle_scatter: float = 0.0
    """Slip of the driven axles that fluctuates between samples, and shows on either axle, ..."""
    own_scatter: float = 0.0
    """... and of each wheel."""
    event_share: float = 0.0
    """Probability of a sample that a wheel spun or was locked in it ..."""
    event_std: float = 0.0
    """... and by how much a wheel is off then."""


@dataclass(frozen=True, slots=True)
class DriveEvidenceSettings:
    """A drive as a whole (`drive_evidence`)."""

    models: tuple[DriveModel, ...] = (
        DriveModel("as learned", 0.86, slip_slope_std=1e-3),
        DriveModel(
            "another load",
            0.08,
            "two tyres of an axle that were soft at its beginning are not seen",
            load_std=(6e-4, 1.75e-3),
            slip_slope_times=(1.1, 0.15),
        ),
        DriveModel(
            "a trailer",
            0.02,
            "two tyres of an axle that were soft at its beginning are not seen",
            load_std=(6e-4, 1.75e-3),
            drag_std=1.6e-3,
            slip_slope_times=(1.5, 0.3),
        ),
        DriveModel(
            "evenly low grip",
            0.01,
            "driven wheels slip, and say little of their radii",
            slip_slope_times=(2.4, 0.4),
            drag_times=(2.4, 0.4),
            slip_std=2.5e-3,
            event_share=0.02,
            event_std=2e-2,
        ),
        DriveModel(
            "low grip",
            0.02,
            "driven wheels slip, and say little of their radii",
            load_std=(6e-4, 3e-3),
            slip_slope_times=(3.0, 1.5),
            drag_times=(3.0, 1.5),
            slip_std=5e-3,
            axle_scatter=3e-3,
            own_scatter=1e-3,
            event_share=0.1,
            event_std=2e-2,
        ),
        DriveModel(
            "loose ground",
            0.01,
            "every wheel slips, spins or locks for itself; a soft tyre shows in the mean of many minutes",
            load_std=(6e-4, 3e-3),
            slip_slope_times=(2.5, 1.0),
            drag_times=(2.5, 1.0),
            slip_std=5e-3,
            axle_scatter=5e-3,
            own_scatter=5e-3,
            event_share=0.2,
            event_std=2e-2,
        ),
    )
    """A full van lowers its rear tyres by 0.9 mm (3 kN a wheel, 0.25 mm per 500 N of a tyre of 1.6 times the
    stiffness), a full compact by 0.8 mm; of loads drawn evenly from none to full the root mean square is 0.58
    of that, 0.54 mm. A trailer's drag area of 1.2 m2 doubles or trebles the drag slip of `physics.priors`,
    and its mass of half to one car the slip on slopes. On ice and
    gravel driven wheels slip by 2 to 3 mm; 1.4 times more of what rolling and drag take at 60 km/h is
    0.9 mm. A full car has a quarter more mass on driven wheels that carry less of it. The slip slope of one
    car varies by a tenth with load, warmth and tread; on snow and gravel it is two to three times that of a
    dry road, on ice more (assumed after Gustafsson 1997). A wheel that is locked for half a second in a
    memory of 25 s turns 2 % less. Shares of drives and samples: assumed."""
    slipping: tuple[str, ...] = ("evenly low grip", "low grip", "loose ground")
    """Those in which driven wheels slip."""
    by_slope: tuple[str, ...] = ("evenly low grip",)
    """Those that only a slip slope tells from a loss of both driven tyres: left out where there is none, or
    they would hide it."""
    estimate_share: float = 2.0
    """Variance of the mean of estimates 20 s apart relative to independent ones: their memory is 4 to 40 s,
    which makes 1.0 to 4.1."""
    lasting_share: float = 0.1
    """Fraction of the fluctuating variance by side and by wheel that lasts all drive long (crown of the road,
    wind).
    """
    kept: int = 12
    """Onsets in doubt of each shape, besides the start and the last ones; the likeliest are kept."""
    start_prior: float = 0.5
    """That a tyre which lost air had lost it when the drive began; else any onset is as likely."""
    resized_while_driving: float = 1e-3
    """Fraction of the drives with wheels of another size on which that came while driving: chains without a
    stop, a receiver that scales (assumed). Nobody changes a wheel then."""
    negligible_nats: float = 12.0
    """Behind the best, from which a change hypothesis is left out: 6e-6 of it at most."""
    min_std: float = 1e-9
    """Keeps the information of an onset from being singular, relative to its largest part."""

    @property
    def load_models(self) -> tuple[str, ...]:
        """Names of the drive models that hide a loss by another load or a trailer, in which no wheel
        slips."""
        return tuple(model.name for model in self.models if model.hides and model.name not in self.slipping)


@dataclass(frozen=True, slots=True)
class SlipSlopeSettings:
    """The slip of driven wheels per acceleration (`slip_slope`, `slip_sums`, `receiver_slip`)."""

    second_s: float = 0.95
    """Over which rotations are summed: a tooth of 48 in a second at 20 m/s is 0.2 %."""
    window_s: float = 20.0
    """In which radii, load and slope hardly change."""
    min_seconds: int = 8
    min_accel2: float = 0.05
    """Sum of squared accelerations, (m/s2)2: 0.05 m/s2 for 20 s; below, it is the counts' noise."""
    slowest_mps: float = 4.0
    """Below, a second holds too few teeth."""
    slowest_against_receiver_mps: float = 8.0
    """Below, a receiver's error of 0.05 m/s is 0.6 % and more."""
    span_s: float = 1.0
    """Time before and after a fix over which the wheels' speed and acceleration are taken, s: a tooth of 48
    is 0.04 m, 0.01 m/s2 over four wheels.
    """
    max_speed_noise: float = 2.0
    """Speed noise of a fix relative to the usual one: beyond it the sky is obstructed."""
    accel_mps2: tuple[float, float] = (-0.4, 2.5)
    """Harder braking than an engine does is done by all four wheels; no road car keeps up more."""
    max_bend: float = 0.06
    """Wheelbase over radius: 45 m. In tighter bends side slip of the front wheels counts."""
    hill_std_mps2: float = 0.1
    """Standard deviation of the road's slope within a window, 1 %, ..."""
    hill_s: float = 10.0
    """... and for how long it does: 200 m."""
    noise_share: float = 2.0
    """Variance of a slope from seconds in a row relative to independent ones: gusts and bumps last longer."""


@dataclass(frozen=True, slots=True)
class LevelSettings:
    """Errors of what all wheels have in common (`common_mode_noise`)."""

    reflected_mps: float = 0.1
    """Error of the receiver's speed by reflected signals, over an estimate's memory of half a minute."""
    reflected_share: float = 0.02
    """Fraction of all samples (assumed)."""
    reflected_samples: float = 4.0
    """Samples in a row, 20 s apart: reflections last for 5 to 40 s, an estimate's memory as long again."""
    slowest_mps: float = 4.0
    """Below, estimates are not informed."""
