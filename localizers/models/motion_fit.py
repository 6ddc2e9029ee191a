"""What the fits of motion models to a log share: which steps count, likelihood, rare failures."""

import numpy as np

from deqmcl_gym.numerics.types import Bools, Floats
from deqmcl_gym.validation import InputError

LEAST_STEPS = 10  # to fit to
SHARE, WITHIN = 0.99, 2.5758  # so much of a normal distribution lies within so many σ
_ROUNDS = 500  # of the fit, which has converged long before
_TINY = 1e-12  # a variance: of (10⁻⁶ rad)², or as small a length


def moving(meant: Floats, done: Floats) -> tuple[Floats, Floats, Bools]:
    """Return the steps with movement and a reference, (k, 3) each, and which have a direction."""
    told, true = np.asarray(meant, np.float64), np.asarray(done, np.float64)
    kept = np.isfinite(told).all(axis=1) & np.isfinite(true[:, ::2]).all(axis=1)
    kept &= np.abs(told).max(axis=1) > 0
    if kept.sum() < LEAST_STEPS:
        raise InputError(
            f"{int(kept.sum())} steps have movement and a reference at both ends, too few to fit "
            f"the noise of the motion to, which needs {LEAST_STEPS}: give the noise instead."
        )
    return told[kept], true[kept], np.isfinite(true[kept, 1])


def longer_half(drive: Floats) -> Bools:
    """Which steps are of the longer half, (k,): noise of the reference matters less in them."""
    return drive >= max(float(np.median(drive)), 1e-9)


def most_likely(errors: Floats, features: Floats) -> tuple[float, ...]:
    """Return α ≥ 0 that maximizes the likelihood of errors (k,) ~ N(0, Σ α_j f_j), f (J, k).

    By multiplicative steps, none of which lowers the likelihood (Févotte & Idier 2011).
    """
    square = errors**2
    used = features.max(axis=1, initial=0.0) > 0
    alphas = np.zeros(len(features))
    alphas[used] = square.mean() / features[used].mean(axis=1) if errors.size else 0.0
    for _ in range(_ROUNDS):
        variance = np.maximum(_mixed(alphas, features), _TINY)
        above = (features * (square / variance**2)).sum(axis=1)
        below = np.maximum((features / variance).sum(axis=1), _TINY)
        alphas = alphas * np.sqrt(above / below)
    return tuple(float(alpha) for alpha in alphas)


def excess(alphas: tuple[float, ...], errors: Floats, features: Floats) -> float:
    """Return the factor, 1 or more, on α that brings 99 % of the errors within 2.58 σ."""
    if errors.size == 0:
        return 1.0
    spread = np.sqrt(np.maximum(_mixed(np.array(alphas), features), _TINY))
    return max(1.0, float(np.quantile(np.abs(errors) / spread, SHARE)) / WITHIN) ** 2


def _mixed(alphas: Floats, features: Floats) -> Floats:
    """Σ α_j f_j, (k,), without BLAS, whose last bits depend on the processor."""
    mixed: Floats = (alphas[:, None] * features).sum(axis=0)
    return mixed
