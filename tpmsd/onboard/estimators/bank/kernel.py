"""Arithmetic of all hypotheses of the bank at once, by NumPy arrays or, where it was built, by compiled code.

In: a `Bank`. Out: the bank, changed in place, and what it says. `ArrayKernel` is the reference; `KERNEL` is
the compiled one (`_bank.c`) where it can be imported. Both give the same within rounding
(tests/onboard/estimators/test_bank_kernel.py), so nothing but time depends on which one runs.
"""

from __future__ import annotations

from types import ModuleType
from typing import NamedTuple, Protocol

import numpy as np

from tpmsd.foundation.kernels import loaded
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank import measurements
from tpmsd.onboard.estimators.bank.batched_kalman import (
    MIN_VARIANCE,
    Weights,
    scalar_update,
    square_weights,
    symmetrise,
)
from tpmsd.onboard.estimators.bank.error_state import MU, PSI, ProcessModel, TickMotion
from tpmsd.onboard.estimators.bank.jump_hypotheses import Bank, normalised
from tpmsd.onboard.estimators.resampling import effective_number
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix, Tick

compiled = loaded("bank")


class Summary(NamedTuple):
    """Moments of all hypotheses together."""

    mean: FloatArray
    """(n,) of the state."""
    radii_m2: FloatArray
    """(d, d) covariance of the radii."""
    east_m2: float
    north_m2: float
    heading_rad2: float
    effective: float
    """Effective number of hypotheses."""


class BankKernel(Protocol):
    """The arithmetic of the bank."""

    def propagate(
        self, process: ProcessModel, bank: Bank, motion: TickMotion, position_std_m: float, drift: FloatArray
    ) -> tuple[float, float]:
        """Move all hypotheses through a tick; return the mean distance (m) and turn (rad). `drift`: of
        `drift_at`."""
        ...

    def update(
        self, bank: Bank, scalar: measurements.Scalar, frozen_from: int | None, weights: Weights
    ) -> None:
        """Correct all hypotheses by a measurement, weights included (`batched_kalman.scalar_update`)."""
        ...

    def antenna_position(
        self, bank: Bank, fix: Fix, tick: Tick, now: measurements.Present
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return what `measurements.antenna_position` returns."""
        ...

    def symmetrise(self, bank: Bank) -> None:
        """Make the covariances symmetric again (`batched_kalman.symmetrise`)."""
        ...

    def complete(self, bank: Bank) -> None:
        """Fill in the part of the covariances that a kernel does not keep, for all who read them
        elsewhere."""
        ...

    def summary(self, bank: Bank, log_weights: FloatArray | None = None) -> Summary:
        """Return mean and covariance over the mixture; `log_weights` (N,) instead of the bank's own."""
        ...


class ArrayKernel:
    """Kernel of NumPy arrays."""

    def propagate(
        self, process: ProcessModel, bank: Bank, motion: TickMotion, position_std_m: float, drift: FloatArray
    ) -> tuple[float, float]:
        """See `BankKernel`."""
        factor = bank.noise_factor
        return process.propagate(bank.mean, bank.covariance, motion, position_std_m, drift, factor)

    def update(
        self, bank: Bank, scalar: measurements.Scalar, frozen_from: int | None, weights: Weights
    ) -> None:
        """See `BankKernel`."""
        bank.log_weights += scalar_update(
            bank.mean, bank.covariance, scalar.innovation, scalar.row, scalar.variance, frozen_from, weights
        )

    def antenna_position(
        self, bank: Bank, fix: Fix, tick: Tick, now: measurements.Present
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """See `BankKernel`."""
        return measurements.antenna_position(bank.mean, fix, tick, now)

    def symmetrise(self, bank: Bank) -> None:
        """See `BankKernel`."""
        symmetrise(bank.covariance)

    def complete(self, bank: Bank) -> None:
        """Do nothing: the covariances are always complete."""

    def summary(self, bank: Bank, log_weights: FloatArray | None = None) -> Summary:
        """See `BankKernel`."""
        weights = bank.weights() if log_weights is None else normalised(log_weights)
        state, spread = bank.state, bank.spread
        mean = state @ weights
        wheels = len(state) - MU
        off = state[MU:] - mean[MU:, None]
        within = (spread[MU:, MU:].reshape(wheels * wheels, -1) @ weights).reshape(wheels, wheels)
        pose = np.einsum("iin->in", spread)[: PSI + 1] + (state[: PSI + 1] - mean[: PSI + 1, None]) ** 2
        east_m2, north_m2, heading_rad2 = (pose @ weights).tolist()
        radii_m2 = within + (off * weights) @ off.T
        return Summary(mean, radii_m2, east_m2, north_m2, heading_rad2, effective_number(weights))


class CompiledKernel:
    """Kernel of compiled code; banks must lie in memory as `error_state.side_by_side` lays them."""

    def __init__(self, module: ModuleType) -> None:
        """`module`: `tpmsd.onboard.estimators.bank._bank`."""
        self._propagate, self._update = module.propagate, module.update
        self._moments, self._antenna = module.moments, module.antenna
        self._symmetrise = module.symmetrise
        self._arrays = ArrayKernel()

    def propagate(
        self, process: ProcessModel, bank: Bank, motion: TickMotion, position_std_m: float, drift: FloatArray
    ) -> tuple[float, float]:
        """See `BankKernel`."""
        travel, turn = self._propagate(
            bank.state,
            bank.spread,
            drift.transpose(1, 2, 0),
            bank.noise_factor,
            *process.kernel_constants(motion, position_std_m),
        )
        return travel, turn

    def update(
        self, bank: Bank, scalar: measurements.Scalar, frozen_from: int | None, weights: Weights
    ) -> None:
        """See `BankKernel`."""
        if weights is not square_weights:
            self._arrays.update(bank, scalar, frozen_from, weights)
            return
        self._update(
            bank.state,
            bank.spread,
            bank.log_weights,
            scalar.innovation,
            scalar.row.T,
            scalar.variance,
            bank.mean.shape[1] if frozen_from is None else frozen_from,
            SETTINGS.robust_from,
            SETTINGS.innovation_dof,
        )

    def antenna_position(
        self, bank: Bank, fix: Fix, tick: Tick, now: measurements.Present
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """See `BankKernel`."""
        state = bank.state
        east, north = np.empty(state.shape[1]), np.empty(state.shape[1])
        east_row, north_row = np.empty_like(state), np.empty_like(state)
        behind_s = (1.0 - fix.fraction) * tick.dt_s
        self._antenna(
            *(east, north, east_row, north_row, state, behind_s, now.speed_mps, now.yaw_rate_radps),
            *(now.antenna_forward_m, now.antenna_left_m),
        )
        return east, north, east_row.T, north_row.T

    def symmetrise(self, bank: Bank) -> None:
        """See `BankKernel`."""
        self._symmetrise(bank.spread, MIN_VARIANCE)

    def complete(self, bank: Bank) -> None:
        """Do nothing: the covariances are always complete."""

    def summary(self, bank: Bank, log_weights: FloatArray | None = None) -> Summary:
        """See `BankKernel`."""
        count, size = bank.mean.shape
        mean, radii_m2, weights = np.empty(size), np.empty((size - MU, size - MU)), np.empty(count)
        log_weights = bank.log_weights if log_weights is None else log_weights
        pose = self._moments(mean, radii_m2, weights, bank.state, bank.spread, log_weights)
        return Summary(mean, radii_m2, *pose)


class HalfKernel(CompiledKernel):
    """Kernel of compiled code that keeps the upper triangle of the covariances alone, for banks of hundreds:
    half of the memory is read and written. The lower triangle is made of it where it is asked for
    (`complete`).
    """

    def __init__(self, module: ModuleType) -> None:
        """`module`: `tpmsd.onboard.estimators.bank._bank`."""
        super().__init__(module)
        self._propagate, self._update = module.propagate_half, module.update_half
        self._symmetrise, self._mirror = module.clamp, module.mirror

    def update(
        self, bank: Bank, scalar: measurements.Scalar, frozen_from: int | None, weights: Weights
    ) -> None:
        """See `BankKernel`."""
        if weights is not square_weights:
            self._mirror(bank.spread)
        super().update(bank, scalar, frozen_from, weights)

    def complete(self, bank: Bank) -> None:
        """Copy the upper triangle of the covariances to the lower one."""
        self._mirror(bank.spread)


KERNEL: BankKernel = ArrayKernel() if compiled is None else CompiledKernel(compiled)
"""The one in use."""
HALF_KERNEL: BankKernel = ArrayKernel() if compiled is None else HalfKernel(compiled)
"""The one in use for particles."""
