from tpmsd.wheels import FloatArray

def recursion(
    inverse_out: FloatArray,
    gain_out: FloatArray,
    spread_out: FloatArray,
    moved: FloatArray,
    fresh: FloatArray,
    start: FloatArray,
    /,
) -> bool: ...
