"""p(o | ô): how likely a single beam's range is, given the exact one."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from deqmcl_gym.numerics import arrays
from deqmcl_gym.numerics.types import Floats, Singles
from deqmcl_gym.validation import InputError, number
from localizers.models import scan_kernels
from localizers.models.normal import normal_cdf, normal_pdf

ATOM = 1.0  # px: the ends of the range count as one pixel each in the uniform share


class BeamDensity(Protocol):
    """p(o | ô) of single beams, and its product over the beams of a scan."""

    def log_likelihood(self, ranges: Floats, expected: Singles, max_range: float) -> Floats:
        """Σ_b log p(o_b | ô_b) for each pose, (n,); arguments as ``density``."""
        ...

    def density(self, ranges: Floats, expected: Floats, max_range: float) -> Floats:
        """Density (at an atom: mass) of each measured range.

        Args:
            ranges: o, (B,) px in [0, max_range].
            expected: ô, exact ray-cast ranges, not cut at max_range, (n, B) px.
            max_range: px.

        Returns:
            (n, B), positive.
        """
        ...


class Mixture(NamedTuple):
    """Σ_b log(peak exp(-½ ((o_b - ô_b) / σ)²) + floor), the log-likelihood of two models below.

    Attributes:
        sigma: σ, px.
        peak, floor: per px.
        ends: whether it holds for ranges of 0 and max_range too.
    """

    sigma: float
    peak: float
    floor: float
    ends: bool

    def log_likelihood(self, ranges: Floats, expected: Singles) -> Floats:
        """Log-likelihood of ranges (B,) for each pose of exact ranges (n, B), compiled, (n,)."""
        out = np.empty(len(expected))
        scan_kernels.mixture(ranges, expected.T, self.sigma, self.peak, self.floor, out)
        return out


@dataclass(frozen=True, kw_only=True)
class _HitOrAnything:
    """A beam hits what it should, with normal noise σ, or, a share u of all, measures anything."""

    sigma: float = 100.0
    uniform: float = 0.05

    def __post_init__(self) -> None:
        number("scan.sigma", self.sigma, low=0, above=True)
        number("scan.uniform", self.uniform, low=0, high=1)

    def _mixture(self, floor: float, *, ends: bool) -> Mixture | None:
        """(1 - u) N(o; ô, σ²) + floor; None if a product of such densities may be no normal."""
        if floor < scan_kernels.LEAST_FLOOR:
            return None
        peak = (1 - self.uniform) / (self.sigma * math.sqrt(2 * math.pi))
        return Mixture(self.sigma, peak, floor, ends)


@dataclass(frozen=True, kw_only=True)
class GaussianUniform(_HitOrAnything):
    """p(o | ô) = (1 - u) N(o; ô, σ²) + u / max_range.

    Attributes:
        sigma: σ > 0, px.
        uniform: u, share of beams that measure anything at all.
    """

    def density(self, ranges: Floats, expected: Floats, max_range: float) -> Floats:
        """Density of each measured range, (n, B) per px."""
        hit = normal_pdf((ranges - expected) / self.sigma) / self.sigma
        return (1 - self.uniform) * hit + self.uniform / max_range

    def log_likelihood(self, ranges: Floats, expected: Singles, max_range: float) -> Floats:
        """Σ_b log p(o_b | ô_b) for each pose, (n,)."""
        mixture = self.mixture(max_range)
        if mixture is None:
            return _log_product(self, ranges, expected, max_range)
        return mixture.log_likelihood(ranges, expected)

    def mixture(self, max_range: float) -> Mixture | None:
        """Return what the log-likelihood is; None if the kernel cannot compute it."""
        return self._mixture(self.uniform / max_range, ends=True)

    def hit_moments(self, expected: Floats, max_range: float) -> tuple[Floats, Floats]:
        """Mean (px) and variance (px²) of a beam that hits what it should, (n, B) each."""
        return expected, np.full_like(expected, self.sigma**2)


@dataclass(frozen=True, kw_only=True)
class CensoredGaussianUniform(_HitOrAnything):
    """The GaussianUniform of a world that adds noise, then clips to [0, max_range].

    Inside, p(o | ô) = (1 - u) N(o; ô, σ²) + v; at o = max_range the mass is
    (1 - u) Φ((ô - max_range) / σ) + v·ATOM, at o = 0 it is (1 - u) Φ(-ô / σ) + v·ATOM, where
    v = u / (max_range + 2 ATOM): densities and masses together come to 1.

    Attributes:
        sigma: σ > 0, px.
        uniform: u, share of beams that measure anything at all.
    """

    def density(self, ranges: Floats, expected: Floats, max_range: float) -> Floats:
        """Density of each measured range inside, mass at the two ends, (n, B)."""
        at_max, at_zero = ranges >= max_range, ranges <= 0
        hit = normal_pdf((ranges - expected) / self.sigma) / self.sigma
        hit[:, at_max] = normal_cdf((expected[:, at_max] - max_range) / self.sigma)
        hit[:, at_zero] = normal_cdf(-expected[:, at_zero] / self.sigma)
        anything = np.where(at_max | at_zero, ATOM, 1.0) * self.uniform / (max_range + 2 * ATOM)
        return (1 - self.uniform) * hit + anything

    def log_likelihood(self, ranges: Floats, expected: Singles, max_range: float) -> Floats:
        """Σ_b log p(o_b | ô_b) for each pose, (n,)."""
        mixture = self.mixture(max_range)
        if mixture is None:
            return _log_product(self, ranges, expected, max_range)
        clipped = (ranges <= 0) | (ranges >= max_range)
        if not clipped.any():
            return mixture.log_likelihood(ranges, expected)
        inside = mixture.log_likelihood(ranges[~clipped], expected[:, ~clipped])
        return inside + _log_product(self, ranges[clipped], expected[:, clipped], max_range)

    def mixture(self, max_range: float) -> Mixture | None:
        """Return what the log-likelihood is between the ends; None if the kernel cannot do it."""
        return self._mixture(self.uniform / (max_range + 2 * ATOM), ends=False)

    def hit_moments(self, expected: Floats, max_range: float) -> tuple[Floats, Floats]:
        """Mean (px) and variance (px²) of a beam that hits what it should, (n, B) each.

        Of a normal variable clipped to [0, max_range].
        """
        low, high = -expected / self.sigma, (max_range - expected) / self.sigma
        inside = normal_cdf(high) - normal_cdf(low)
        at_max, slope = 1 - normal_cdf(high), normal_pdf(low) - normal_pdf(high)
        mean = expected * inside + self.sigma * slope + max_range * at_max
        square = (
            (expected**2 + self.sigma**2) * inside
            + self.sigma * (expected * slope - max_range * normal_pdf(high))
            + max_range**2 * at_max
        )
        return mean, square - mean**2


@dataclass(frozen=True, kw_only=True)
class BeamModel:
    """The four-part beam model of Thrun et al. 2005, table 6.1: hit, short, max, rand.

    Attributes:
        hit, short, max, rand: shares of the parts, with sum 1.
        sigma: σ_hit > 0, px.
        decay: λ_short > 0, per px.
    """

    hit: float = 0.8
    short: float = 0.1
    max: float = 0.05
    rand: float = 0.05
    sigma: float = 100.0
    decay: float = 0.01

    def __post_init__(self) -> None:
        shares = {name: getattr(self, name) for name in ("hit", "short", "max", "rand")}
        for name, share in shares.items():
            number(f"scan.{name}", share, low=0, high=1)
        number("scan.sigma", self.sigma, low=0, above=True)
        number("scan.decay", self.decay, low=0, above=True)
        if abs(sum(shares.values()) - 1) > 1e-9:
            raise InputError(
                f"the shares of the beam model add up to {sum(shares.values()):g} "
                f"({shares}), but must add up to 1."
            )

    def density(self, ranges: Floats, expected: Floats, max_range: float) -> Floats:
        """Density of each measured range below max_range, mass at it, (n, B)."""
        seen = np.minimum(expected, max_range)
        inside = normal_cdf((max_range - seen) / self.sigma) - normal_cdf(-seen / self.sigma)
        hit = normal_pdf((ranges - seen) / self.sigma) / (self.sigma * inside)
        cut = 1 - arrays.exp(-self.decay * np.maximum(seen, 1e-6))
        short = np.where(ranges <= seen, self.decay * arrays.exp(-self.decay * ranges) / cut, 0.0)
        at_max = ranges >= max_range
        density: Floats = (
            self.hit * hit
            + self.short * short
            + self.max * at_max
            + self.rand * ~at_max / max_range
        )
        return density

    def log_likelihood(self, ranges: Floats, expected: Singles, max_range: float) -> Floats:
        """Σ_b log p(o_b | ô_b) for each pose, (n,)."""
        return _log_product(self, ranges, expected, max_range)

    def hit_moments(self, expected: Floats, max_range: float) -> tuple[Floats, Floats]:
        """Mean (px) and variance (px²) of a beam that hits what it should, (n, B) each.

        Of a normal variable cut to [0, max_range].
        """
        seen = np.minimum(expected, max_range)
        low, high = -seen / self.sigma, (max_range - seen) / self.sigma
        inside = normal_cdf(high) - normal_cdf(low)
        shift = (normal_pdf(low) - normal_pdf(high)) / inside
        spread = 1 + (low * normal_pdf(low) - high * normal_pdf(high)) / inside - shift**2
        return seen + self.sigma * shift, self.sigma**2 * spread


def _log_product(beam: BeamDensity, ranges: Floats, expected: Singles, max_range: float) -> Floats:
    """Σ_b log of ``beam.density`` for each pose, (n,)."""
    density = beam.density(ranges, expected.astype(np.float64), max_range)
    total: Floats = arrays.log(density).sum(axis=1)
    return total
