"""Base class of an effect of vehicle dynamics: a piece of physics that a baseline model leaves out.

In: nothing. Out: the base class `DynamicsEffect`. A concrete effect is a frozen dataclass in
`tpmsd.car.physics.dynamics_effects` whose fields are its parameters; it overrides the one or two hooks
through which it acts. Hooks change a `Frame` in place, in the order in which they are listed here, and work
on arrays of any shape that broadcasts with the frame's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import is_
from typing import Any, ClassVar

from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.baselines.inputs import Inputs
from tpmsd.car.physics.effect_records import Wording, fold_attributes_into_records
from tpmsd.car.physics.parameters import AnyParameter, Parameter, Value
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray

PHYSICS, INSTRUMENT, EVENT, FREE = "physics", "instrument", "event", "free"
"""Kinds: of car and road, of a sensor, of a span of time, a description without a formula."""
NUISANCE = "nuisance"
"""Kind of what every car has and a baseline simplifies: it is fitted beside the findings and is none."""

EARLY_HOOKS = ("shift_series", "adapt_car", "adapt_inputs", "adapt_loads", "adapt_angles", "adapt_tyres")
"""Hooks that act before the tyres' forces are known."""
ANGLE_HOOKS = ("adapt_angles", "adapt_tyres")
"""Hooks that may read loads before the tyres' forces without a limit are known."""
MOVING_HOOKS = (*EARLY_HOOKS, "add_forces", "add_rates")
"""Hooks by which the car moves otherwise; `read` changes readings alone."""


@dataclass(frozen=True)
class DynamicsEffect:
    """One effect with its values. Sub-classes are frozen dataclasses with one field per parameter."""

    name: ClassVar[str]
    kind: ClassVar[str] = PHYSICS
    wording: ClassVar[Wording] = Wording()
    """The words for it."""
    parameters: ClassVar[tuple[AnyParameter, ...]] = ()
    channel: ClassVar[str] = "yaw_rate"
    """The output in which it shows most, where the drive does not show it."""
    covariate: ClassVar[str | None] = None
    """The variable that it depends on; None: time."""
    grid: ClassVar[tuple[Mapping[str, float], ...]] = ()
    """Values at which it is looked for where it enters nonlinearly; empty: it is linear about neutral."""
    states: ClassVar[tuple[str, ...]] = ()
    """States that it adds once it belongs to a model."""
    state_sizes: ClassVar[tuple[float, ...]] = ()
    """Values that its states hardly exceed, in their order; 1 each unless given."""
    needs_forces: ClassVar[bool] = False
    """True if the effect shows only where speed is an output."""
    positive: ClassVar[bool] = False
    """True if only one sign of the first parameter is physically possible."""
    relative_std: ClassVar[float] = 0.0
    """Standard deviation of its first value, over the value, by constants of the car that nobody states."""
    separable: ClassVar[bool] = False
    """True if each of its parameters may have a value while the others do nothing."""
    shaped_by: ClassVar[tuple[str, ...]] = ()
    """Parameters that do nothing while the others are neutral, and have no neutral value themselves."""
    shows_in: ClassVar[Mapping[str, str]] = {}
    """Outputs by parameter, for parameters that show in one output alone."""
    composes: ClassVar[bool] = True
    """True if two of it act as one: not where it adds states or sets a value in place of the configured."""
    acts_with: ClassVar[tuple[str, ...]] = ()
    """Effects without any of which it does nothing; empty: it acts alone."""
    confounded_with: ClassVar[tuple[str, ...]] = ()
    """Effects that it is often confounded with, for the reference."""
    acts_early: ClassVar[bool] = False
    """True if one of its hooks acts before the tyres' forces are known."""
    acts_on_angles: ClassVar[bool] = False
    """True if one of its hooks acts on slip angles or stiffnesses."""
    reads_loads: ClassVar[bool] = True
    """False if these hooks read neither loads nor the accelerations that loads follow."""
    moves_car: ClassVar[bool] = False
    """True if the car moves otherwise with it."""
    order: ClassVar[int] = 0
    """Effects that share a hook act in the order of this number, then of their names."""

    def __post_init__(self) -> None:
        for parameter in self.parameters:
            value = getattr(self, parameter.name)
            if not isinstance(value, float | int | str | tuple | list):
                continue  # an array of values that broadcasts, made by a caller that knows the limits
            try:
                object.__setattr__(self, parameter.name, parameter.check(value))
            except ValueError as error:
                raise ConfigError(f"effect {self.name}: {error}") from None

    def values(self) -> dict[str, Value]:
        """Return the parameters by name."""
        return {p.name: getattr(self, p.name) for p in self.parameters}

    def unit_of(self, parameter: str) -> str:
        """Return the unit of one of its parameters; empty where it has none."""
        return next(p.unit for p in self.parameters if p.name == parameter)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        fold_attributes_into_records(cls)
        cls.acts_early, cls.acts_on_angles, cls.moves_car = (
            any(getattr(cls, hook) is not getattr(DynamicsEffect, hook) for hook in hooks)
            for hooks in (EARLY_HOOKS, ANGLE_HOOKS, MOVING_HOOKS)
        )

    @classmethod
    def sizes_of_states(cls) -> dict[str, float]:
        """Return the sizes of its states by name."""
        return dict(zip(cls.states, cls.state_sizes or (1.0,) * len(cls.states), strict=True))

    @classmethod
    def numbers(cls) -> tuple[Parameter, ...]:
        """Return the parameters that are fitted."""
        return tuple(p for p in cls.parameters if isinstance(p, Parameter) and p.probe > 0.0)

    @classmethod
    def neutral_values(cls, car: DynamicCar, nonlinear: bool) -> dict[str, float]:
        """Return the values with which it does nothing on this car."""
        return {p.name: p.neutral for p in cls.parameters if isinstance(p, Parameter)}

    @classmethod
    def variants(cls, nonlinear: bool) -> tuple[Mapping[str, float], ...]:
        """Return the sets of values of parameters that are not fitted; the effect is tried with each."""
        return ({},)

    @classmethod
    def has_neutral(cls, nonlinear: bool) -> bool:
        """Return True if some values of it do nothing, from which a fit's distance is measured."""
        return True

    @classmethod
    def near_neutral(cls, nonlinear: bool) -> bool:
        """Return True if an effect with a grid is looked for about its neutral values too."""
        return False

    @classmethod
    def applies(cls, nonlinear: bool, forces: bool) -> bool:
        """Return True if the effect can act on a baseline with these tyres and inputs."""
        return forces or not cls.needs_forces

    def follows_instant(self) -> bool:
        """Return True if it acts on slip angles by the accelerations that the tyres give."""
        return False

    def fastest_rate_per_s(self, speed_mps: float) -> float:
        """Return the rate constant of its own states at most at this speed."""
        return 0.0

    def mass_share(self) -> float:
        """Return the least share of the car's mass that sudden forces of the tyres move sideways."""
        return 1.0

    def decays_per_s(self, speed_mps: FloatArray) -> dict[str, FloatArray]:
        """Return the rate constants, 1/s, of its first-order states, by state, at these speeds; empty where
        its states swing, or it has none."""
        return {}

    def shift_series(self, inputs: Inputs) -> Inputs:
        """Change inputs over a whole recording, arrays (n,): delays."""
        return inputs

    def adapt_car(self, frame: Frame) -> None:
        """Change masses, lengths, stiffnesses and limits."""

    def adapt_inputs(self, frame: Frame) -> None:
        """Change steering and forces as they act."""

    def adapt_loads(self, frame: Frame) -> None:
        """Change loads and load transfer."""

    def adapt_angles(self, frame: Frame) -> None:
        """Change slip angles."""

    def adapt_tyres(self, frame: Frame) -> None:
        """Change stiffnesses once loads and slip angles are known."""

    def add_forces(self, frame: Frame) -> None:
        """Add forces, moments and gravity once the tyres' forces are known."""

    def add_rates(self, frame: Frame) -> None:
        """Add the rates of its own states, or change those of others."""

    def read(self, frame: Frame) -> None:
        """Change what the instruments read."""


def sorted_by_order(theta: Sequence[DynamicsEffect]) -> list[DynamicsEffect]:
    """Return effects sorted by `order`, then name: the order in which they act.

    A derivative by one parameter compares two models: were its effect the last to act in one of them alone,
    the difference would hold what the order does, over the size of the probe.
    """
    return sorted(theta, key=lambda effect: (effect.order, effect.name))


def same_motion(theta: Sequence[DynamicsEffect], other: Sequence[DynamicsEffect]) -> bool:
    """Return True if two models move the car alike: they share the effects that move it."""
    one, two = ([effect for effect in sorted_by_order(each) if effect.moves_car] for each in (theta, other))
    return len(one) == len(two) and all(map(is_, one, two))


def effects_before_forces(theta: Sequence[DynamicsEffect]) -> tuple[DynamicsEffect, ...]:
    """Return the effects that act before the tyres' forces are known, in their order."""
    return tuple(effect for effect in theta if effect.acts_early)
