"""Statistics over worlds."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_RESAMPLES = 10_000


def sample_sd(values: Floats) -> float:
    """Standard deviation with ddof 1; NaN of fewer than two."""
    return float(np.std(values, ddof=1)) if values.size > 1 else float("nan")


def paired_bootstrap(differences: Floats, level: float = 0.95) -> tuple[float, float]:
    """Percentile bootstrap interval of the mean of paired differences, over worlds.

    10,000 resamples with a fixed seed: the same differences give the same interval. NaN of fewer
    than two. With ten worlds it is somewhat too narrow, as every percentile bootstrap is.
    """
    if differences.size < 2:
        return float("nan"), float("nan")
    rng = np.random.default_rng(0)
    means = np.empty(_RESAMPLES)
    for i in range(_RESAMPLES):
        means[i] = differences[rng.integers(differences.size, size=differences.size)].mean()
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)
