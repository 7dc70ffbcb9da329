from tpmsd.foundation.wheels import FloatArray

def recursion(
    inverse_out: FloatArray,
    gain_out: FloatArray,
    spread_out: FloatArray,
    moved: FloatArray,
    fresh: FloatArray,
    start: FloatArray,
    /,
) -> bool: ...
def apply(
    out: FloatArray,
    columns: FloatArray,
    moved: FloatArray,
    inverse: FloatArray,
    gain: FloatArray,
    here: FloatArray,
    /,
) -> None: ...
def chain(out: FloatArray, last_out: FloatArray, step: FloatArray, added: FloatArray, /) -> None: ...
def scores(
    variance_out: FloatArray,
    decay_out: FloatArray,
    fresh_out: FloatArray,
    start_out: FloatArray,
    states_room: FloatArray,
    scores_room: FloatArray,
    moved: FloatArray,
    joint: FloatArray,
    inverse: FloatArray,
    gain: FloatArray,
    spread: FloatArray,
    white: FloatArray,
    carried: FloatArray,
    /,
) -> None: ...
