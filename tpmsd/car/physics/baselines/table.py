"""The baselines of vehicle dynamics by name.

In: a name. Out: the class. `rolling`, the baseline of wheels and receiver, is `tpmsd.car.physics.model`.
"""

from __future__ import annotations

from tpmsd.car.physics.baselines.base import Baseline
from tpmsd.car.physics.baselines.single_track import SingleTrack
from tpmsd.car.physics.baselines.three_dof import ThreeDof

BASELINES: dict[str, type[Baseline]] = {one.name: one for one in (SingleTrack, ThreeDof)}
