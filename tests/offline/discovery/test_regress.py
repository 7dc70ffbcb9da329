"""Standard errors of the block jackknife, against errors that are known."""

from __future__ import annotations

import numpy as np

from tpmsd.offline.discovery.regress import fit


def test_few_blocks_that_weigh_much() -> None:
    """Where four of thirty blocks hold the motion, the stated error is that of repeated drives."""
    rng = np.random.default_rng(5)
    block = np.repeat(np.arange(30), 20)
    size = np.where(np.arange(30) % 8 == 0, 1.0, 0.1)
    motion = (size[:, None] * rng.standard_normal((30, 2)))[block]
    errors, stated = [], []
    for _ in range(400):
        # Errors of a block go together.
        noise = 0.1 * rng.standard_normal(30)[block] + 0.1 * rng.standard_normal(600)
        made = fit(motion, motion @ [2.0, -1.0] + noise, block)
        assert made is not None
        errors.append(made.value[0] - 2.0)
        stated.append(made.std(0))

    true_std = float(np.std(errors))
    assert 0.9 * true_std < float(np.sqrt(np.mean(np.square(stated)))) < 2.0 * true_std
