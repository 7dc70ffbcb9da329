from tpmsd.foundation.wheels import FloatArray

def propagate(
    mean: FloatArray, covariance: FloatArray, drift: FloatArray, /, *motion: float
) -> tuple[float, float]: ...
def update(
    mean: FloatArray,
    covariance: FloatArray,
    log_weights: FloatArray,
    innovation: FloatArray,
    row: FloatArray,
    variance: float,
    frozen_from: int,
    robust_from: float,
    dof: float,
    /,
) -> None: ...
def symmetrise(covariance: FloatArray, least: float, /) -> None: ...
def moments(
    mean_out: FloatArray,
    radii_out: FloatArray,
    weights_out: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    log_weights: FloatArray,
    /,
) -> tuple[float, float, float, float]: ...
def antenna(
    east_out: FloatArray,
    north_out: FloatArray,
    east_row_out: FloatArray,
    north_row_out: FloatArray,
    mean: FloatArray,
    behind_s: float,
    speed_mps: float,
    yaw_rate_radps: float,
    forward_m: float,
    left_m: float,
    /,
) -> None: ...
