"""The wheels, in the one order that every array of the project uses.

Arrays and their type are made on first use: numpy takes longer to import than `tpmsd status` may take.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

WHEELS = ("fl", "fr", "rl", "rr")
"""Front left, front right, rear left, rear right."""

FL, FR, RL, RR = range(4)
AXLES = ((FL, FR), (RL, RR))
"""Left and right of each, front first."""

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    IS_FRONT: NDArray[np.bool_]
    IS_LEFT: NDArray[np.bool_]
else:

    def __getattr__(name: str) -> Any:
        if name not in ("FloatArray", "IS_FRONT", "IS_LEFT"):  # the import system asks for others
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        import numpy as np
        from numpy.typing import NDArray

        globals().update(
            FloatArray=NDArray[np.float64],
            IS_FRONT=np.array([True, True, False, False]),
            IS_LEFT=np.array([True, False, True, False]),
        )
        return globals()[name]
