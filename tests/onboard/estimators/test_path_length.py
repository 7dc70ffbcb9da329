"""Positions against the integral of speed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpmsd.onboard.estimators.gates.path_length import PathLength
from tpmsd.onboard.estimators.settings import PATH_LENGTH
from tpmsd.onboard.timeline.tick import Fix


def driven(
    duration_s: float,
    scale: float = 1.0,
    *,
    rate_hz: float = 1.0,
    lag_s: float = 0.0,
    noise_m: float = 0.0,
    quality: int = 1,
    jump_m: float = 0.0,
    window_s: float = PATH_LENGTH.windows_s[0],
    wander_m: float = 0.0,
    seed: int = 3,
) -> tuple[PathLength, list[bool]]:
    """A winding road at 15 to 25 m/s; speeds are scaled, late and rounded to 0.1 knots.

    `wander_m`: standard deviation of positions with a memory of 90 s, each way."""
    rng = np.random.default_rng(seed)
    wander, kept = rng.normal(0.0, wander_m, 2), math.exp(-1.0 / rate_hz / 90.0)
    watch, apart = PathLength(window_s), []
    east = north = 0.0
    steps = 20
    for k in range(round(duration_s * rate_hz)):
        for j in range(steps):
            t = (k + j / steps) / rate_hz
            heading = 1.2 * math.sin(t / 15.0)
            east += (20.0 + 5.0 * math.sin(t / 20.0)) * math.cos(heading) / rate_hz / steps
            north += (20.0 + 5.0 * math.sin(t / 20.0)) * math.sin(heading) / rate_hz / steps
        t = (k + 1) / rate_hz
        speed = scale * (20.0 + 5.0 * math.sin((t - lag_s) / 20.0))
        wander = kept * wander + rng.normal(0.0, wander_m * math.sqrt(1.0 - kept * kept), 2)
        error = rng.normal(0.0, noise_m, 2) + wander
        jumped = jump_m if t > 0.5 * duration_s else 0.0
        fix = Fix(
            time_s=t,
            fraction=0.5,
            east_m=east + error[0] + jumped,
            north_m=north + error[1],
            position_std_m=1.0,
            speed_mps=round(speed / 0.05144) * 0.05144,
            heading_rad=1.2 * math.sin((t - lag_s) / 15.0),
            quality=quality,
        )
        watch.update(fix)
        apart.append(watch.apart)
    return watch, apart


@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 10.0])
def test_arcs_of_an_honest_drive_add_up_to_its_speed(rate_hz: float) -> None:
    """In bends of 1/80 m the path by positions is the integral of speed within 0.1 %."""
    watch, _ = driven(120.0, rate_hz=rate_hz)
    assert pytest.approx(0.0, abs=1e-3 * 1200.0) == watch.difference_m


@pytest.mark.parametrize("scale", [0.985, 1.015])
def test_a_scale_of_one_and_a_half_per_cent_parts_them(scale: float) -> None:
    """Within a minute."""
    assert any(driven(60.0, scale)[1])


@pytest.mark.parametrize(
    "kind",
    [{}, {"lag_s": 0.8}, {"noise_m": 0.3}, {"jump_m": 30.0}, {"scale": 1.002}, {"scale": 0.97, "quality": 5}],
    ids=["honest", "late", "noisy", "a position that jumps", "a scale of 0.2 %", "float ambiguities"],
)
def test_what_receivers_do_is_no_lie(kind: dict[str, float]) -> None:
    """Late speeds, noise, a new solution and float ambiguities part nothing."""
    for window_s in PATH_LENGTH.windows_s:
        assert not any(driven(240.0, window_s=window_s, **kind)[1])  # type: ignore[arg-type]


@pytest.mark.parametrize("scale", [0.995, 1.005])
def test_the_long_window_finds_a_scale_of_half_a_per_cent(scale: float) -> None:
    """At 72 km/h a speed that is 0.5 % off is found in three minutes, by the long window alone; honest speeds
    that are late, with positions that scatter, are not found out of anything."""
    _, short = driven(300.0, scale)
    _, long = driven(300.0, scale, window_s=PATH_LENGTH.windows_s[1])
    _, honest = driven(600.0, lag_s=0.3, noise_m=0.3, window_s=PATH_LENGTH.windows_s[1])
    assert not any(short)
    assert any(long[:180])
    assert not any(honest)


@pytest.mark.parametrize("window_s", PATH_LENGTH.windows_s)
def test_positions_that_wander_by_metres_are_no_lie(window_s: float) -> None:
    """Twenty honest drives of ten minutes with positions that wander by 3 m, as those of plain receivers:
    none is found out of anything; a scale of 3 % is, in each of five."""
    honest = [any(driven(600.0, window_s=window_s, wander_m=3.0, seed=k)[1]) for k in range(20)]
    scaled = [any(driven(240.0, 1.03, window_s=window_s, wander_m=3.0, seed=k)[1]) for k in range(5)]
    assert [False] * 20 == honest
    assert [True] * 5 == scaled
