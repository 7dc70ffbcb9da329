import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray

def lines(
    text: bytes,
    channel: bytes,
    found: NDArray[np.bool_],
    time_s: FloatArray,
    identifier: NDArray[np.uint32],
    size: NDArray[np.uint8],
    data: NDArray[np.uint8],
    /,
) -> int: ...
