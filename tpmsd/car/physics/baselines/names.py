"""Names of the baselines, without their models: the command line lists them before anything else is loaded.

In: nothing. Out: names.
"""

from __future__ import annotations

ROLLING = "rolling"
"""Baseline of wheels and receiver (`tpmsd.car.physics.model`)."""
SINGLE_TRACK = "single-track"
THREE_DOF = "three-dof"
DYNAMICS_BASELINES = (SINGLE_TRACK, THREE_DOF)
"""Baselines of vehicle dynamics, in the order of `tpmsd.car.physics.baselines.table`."""
BASELINE_NAMES = (ROLLING, *DYNAMICS_BASELINES)
