"""The settings of encoders that lose counts (a part of `settings`).

In: nothing. Out: `EncoderSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class EncoderSettings:
    """The ripple of a ring, once per revolution (`encoder_watch`)."""

    min_counts: float = 2000.0
    """Counts per revolution at least: a usual ripple of a few tenths of a milliradian is a tenth of a count
    there, and seen.
    """
    from_hz: float = 8.0
    """Turns per second of both wheels: two and more in `high_pass_s`."""
    high_pass_s: float = 0.3
    """Width of the Gaussian that takes slow differences between the wheels away."""
    edge_widths: int = 4
    """Distance at which it ends on each side, in widths."""
    block_s: float = 60.0
    """In which a ripple is coherent: 700 turns tell shares of 1e-3 apart."""
    kept: int = 10
    """Blocks that speak: the last ten minutes above `from_hz`."""
    min_blocks: int = 3
    """From so many on they are trusted: in one the other wheel's ripple may lie at any share."""
    min_stds: float = 3.0
    """Standard deviations of the `ring_error` of both wheels from which one has fewer counts than the other.
    """
    raise_nats: float = 10.0
    """Over that of a counter that loses none. By noise alone half a chi-square of one degree is beyond with
    4e-6; of some thirty shares, two wheels and three stretches, one in a thousand drives passes."""
    clear_nats: float = 5.0
    """Down to which a loss stands: half of it, for the last minutes of a loss that stands go up and down."""
