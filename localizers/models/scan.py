"""p(o_t | x_t, m): how likely a beam's range is, given the exact one, and a scan at a pose."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.map import LENGTH, PER_LENGTH
from deqmcl_gym.numerics import Bools, Floats, Singles, arrays
from deqmcl_gym.numerics.arrays import normal_cdf
from deqmcl_gym.validation import InputError, digits, keep_plain, number
from localizers.models import beam_kernels


def normal_pdf(z: Floats) -> Floats:
    """N(z; 0, 1)."""
    return arrays.exp(-0.5 * np.square(z)) / math.sqrt(2 * math.pi)


METRE_SIGMA = 0.2  # m, of a beam: Nav2's sigma_hit
_STEPS = 400  # the uniform share's mass at an end of the range is that of 1 step: 1 px of 400 px
_WIDEST = 1e4  # ranges: largest σ; it is flat, and the share of a wider one would lose its digits


class BeamDensity(Protocol):
    """p(o | ô) of single beams, and its product over the beams of a scan."""

    @property
    def power(self) -> float:
        """Exponent of the likelihood, in (0, 1]."""

    def log_likelihood(self, ranges: Floats, expected: Singles, max_range: float) -> Floats:
        """Σ_b log p(o_b | ô_b) for each pose, (n,), of masses at an atom; NaN if a ô_b is.

        Measured ranges o, (B,), are in [0, max_range], exact ones ô, (n, B), are not cut at it.
        """

    def least_density(self, max_range: float) -> float:
        """Return what density and mass of a beam are never below, whatever o and ô."""


@dataclass(frozen=True, kw_only=True)
class _Tempered:
    """p(o | ô)^power: dependent beams carry less information than independent ones."""

    power: float = 1.0  # in (0, 1]; 1 is Bayes' rule for independent beams

    def __post_init__(self) -> None:
        number("scan.power", self.power, low=0, high=1, above=True)
        keep_plain(self)


@lru_cache
def _anything(uniform: float, max_range: float, clipped: bool) -> tuple[float, float, float, float]:
    """Return the uniform share's density, the ends of the range if it clips, and its mass there."""
    if not clipped:
        return uniform / max_range, -math.inf, math.inf, math.inf
    step = max_range / _STEPS
    floor = uniform / (max_range + 2 * step)
    return floor, 0.0, max_range, step * floor


@dataclass(frozen=True, kw_only=True)
class _HitOrAnything(_Tempered):
    """A beam hits the expected wall with normal noise σ or, with probability u, reads anything."""

    _clips: ClassVar[bool]  # whether ranges end at 0 and max_range, with masses there

    sigma: float = field(default=100.0, metadata=LENGTH)
    uniform: float = 0.05

    def __post_init__(self) -> None:
        super().__post_init__()
        number("scan.sigma", self.sigma, low=0, above=True)
        number("scan.uniform", self.uniform, low=0, high=1)

    def least_density(self, max_range: float) -> float:
        """Return the least density or mass of a beam far from its expected range."""
        floor, *_, atom = _anything(self.uniform, max_range, self._clips)
        return float(min(floor, atom) ** self.power)

    def log_likelihood(self, ranges: Floats, expected: Singles, max_range: float) -> Floats:
        """Σ_b log p(o_b | ô_b) for each pose, (n,)."""
        out = np.empty(len(expected))
        hit, anything = 1 - self.uniform, _anything(self.uniform, max_range, self._clips)
        beam_kernels.gaussian_uniform(ranges, expected.T, self.sigma, hit, *anything, out)
        return self.power * out


@dataclass(frozen=True, kw_only=True)
class GaussianUniform(_HitOrAnything):
    """p(o | ô) = (1 - u) N(o; ô, σ²) + u / max_range.

    σ = ``sigma`` > 0 is in the map's unit; u = ``uniform`` is the share of beams of any range.
    """

    _clips = False

    def hit_moments(self, expected: Floats, max_range: float) -> tuple[Floats, Floats]:
        """Mean and variance of a beam that hits the expected wall, (n, B) each."""
        return expected, np.full_like(expected, self.sigma**2 / self.power)


@dataclass(frozen=True, kw_only=True)
class CensoredGaussianUniform(_HitOrAnything):
    """The GaussianUniform of a world that adds noise, then clips to [0, max_range].

    Inside, p(o | ô) = (1 - u) N(o; ô, σ²) + v; at o = max_range the mass is
    (1 - u) Φ((ô - max_range) / σ) + v s, at o = 0 it is (1 - u) Φ(-ô / σ) + v s, where
    s = max_range / 400 is a step of the range and v = u / (max_range + 2 s): densities and masses
    together come to 1. σ = ``sigma`` and u = ``uniform`` are those of ``GaussianUniform``.
    """

    _clips = True

    def hit_moments(self, expected: Floats, max_range: float) -> tuple[Floats, Floats]:
        """Mean and variance of a normal variable clipped to [0, max_range], (n, B) each."""
        low, high = -expected / self.sigma, (max_range - expected) / self.sigma
        inside = normal_cdf(high) - normal_cdf(low)
        at_max, slope = 1 - normal_cdf(high), normal_pdf(low) - normal_pdf(high)
        mean = expected * inside + self.sigma * slope + max_range * at_max
        square = (
            (expected**2 + self.sigma**2) * inside
            + self.sigma * (expected * slope - max_range * normal_pdf(high))
            + max_range**2 * at_max
        )
        return mean, np.maximum(square - mean**2, 0.0) / self.power


@dataclass(frozen=True, kw_only=True)
class BeamModel(_Tempered):
    """The four-part beam model of Thrun et al. 2005, table 6.1: hit, short, max, rand."""

    hit: float = 0.8  #: share of beams that hit the expected wall; the four have sum 1
    short: float = 0.1  #: of those that are too short
    max: float = 0.05  #: of those that read max_range
    rand: float = 0.05  #: of those that read any range
    sigma: float = field(default=100.0, metadata=LENGTH)  #: σ_hit > 0, in the map's unit
    decay: float = field(default=0.01, metadata=PER_LENGTH)  #: λ_short > 0, per unit of length

    def __post_init__(self) -> None:
        super().__post_init__()
        shares = {name: getattr(self, name) for name in ("hit", "short", "max", "rand")}
        for name, share in shares.items():
            number(f"scan.{name}", share, low=0, high=1)
        number("scan.sigma", self.sigma, low=0, above=True)
        number("scan.decay", self.decay, low=0, above=True)
        if abs(sum(shares.values()) - 1) > 1e-9:
            raise InputError(
                f"the shares of the beam model add up to {digits(sum(shares.values()))} "
                f"({shares}), but must add up to 1."
            )

    def least_density(self, max_range: float) -> float:
        """Return the least density or mass of a beam far from its expected range."""
        return float(min(self.rand / max_range, self.max) ** self.power)

    def log_likelihood(self, ranges: Floats, expected: Singles, max_range: float) -> Floats:
        """Σ_b log p(o_b | ô_b) for each pose, (n,)."""
        out, nearest = np.empty(len(expected)), 1e-6 * max_range / _STEPS  # no division by 0
        shares = float(self.hit), float(self.short), float(self.max), float(self.rand)
        beam_kernels.four_parts(
            ranges, expected.T, shares, self._width(max_range), self.decay, nearest, max_range, out
        )
        return self.power * out

    def _width(self, max_range: float) -> float:
        return min(self.sigma, _WIDEST * max_range)

    def hit_moments(self, expected: Floats, max_range: float) -> tuple[Floats, Floats]:
        """Mean and variance of a normal variable cut to [0, max_range], (n, B) each."""
        seen, sigma = np.minimum(expected, max_range), self._width(max_range)
        low, high = -seen / sigma, (max_range - seen) / sigma
        inside = normal_cdf(high) - normal_cdf(low)
        shift = (normal_pdf(low) - normal_pdf(high)) / inside
        spread = 1 + (low * normal_pdf(low) - high * normal_pdf(high)) / inside - shift**2
        return seen + sigma * shift, sigma**2 * spread / self.power


@dataclass(frozen=True, kw_only=True)
class LatentShare(CensoredGaussianUniform):
    """The CensoredGaussianUniform of a scan whose share of unexplained beams is unknown.

    p(o | ô) = ∫ Beta(u) Π_b ((1 - u) p_hit(o_b | ô_b) + u p_any(o_b)) du: a crowd hides many beams
    of one scan and none of the next. ``uniform`` is E[u]; u is summed out exactly. Of one beam it
    is a ``CensoredGaussianUniform``; of several, each unexplained beam makes the next one likelier,
    and as E[u^B] ≥ E[u]^B, B beams are never below the B-th power of ``least_density``.
    """

    #: c > 0, u ~ Beta(c E[u], c (1 - E[u])); the larger, the more alike scans are; at ∞ u is E[u]
    concentration: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        number("scan.concentration", self.concentration, low=0, above=True)

    def log_likelihood(self, ranges: Floats, expected: Singles, max_range: float) -> Floats:
        """Log p(o | ô) of the whole scan for each pose, (n,)."""
        out = np.empty(len(expected))
        c, u = float(self.concentration), float(self.uniform)
        counts = c * u, c * (1 - u)
        anything = _anything(1.0, max_range, self._clips)
        beam_kernels.latent_share(ranges, expected.T, self.sigma, counts, *anything, out)
        return self.power * out


BEAM_MODELS: Mapping[str, type[BeamDensity]] = {
    "gaussian-uniform": GaussianUniform,
    "censored-gaussian-uniform": CensoredGaussianUniform,
    "beam-model": BeamModel,
    "latent-share": LatentShare,
}


class Scan(NamedTuple):
    """A scan o_t, (B,): which beams are ``usable``, numbers in [0, max_range], and how many."""

    ranges: Floats
    usable: Bools
    beams: int

    @classmethod
    def of(cls, ranges: Floats, max_range: float) -> "Scan":
        """Return a scan; the ranges (B,) are kept, not copied."""
        usable = (ranges >= 0.0) & (ranges <= max_range)  # false for NaN
        return cls(ranges, usable, int(usable.sum()))

    def without(self, dropped: Bools | bool, among: Bools) -> "Scan":
        """Return this scan with no measurement by those dropped, (b,), among some beams, (B,)."""
        left_out = np.zeros(among.size, np.bool_)
        left_out[among] = dropped
        if not left_out.any():
            return self
        usable = self.usable & ~left_out
        return Scan(np.where(left_out, np.nan, self.ranges), usable, int(usable.sum()))


class ScanModel(Protocol):
    """p(o_t | x_t, m)."""

    def log_likelihood(self, states: Singles, scan: Scan) -> Floats:
        """Log-likelihood of a scan at each of n poses, (n,), finite or -inf, up to a constant.

        Poses are rows x, y (in the map's unit), θ (rad), float32, (3, n): any, also in a wall or
        off the map. They and the scan's ranges, (B,), in the map's unit, are not to be written to.
        The constant is the same for all poses and scans.
        """


@runtime_checkable
class ScanSource(Protocol):
    """What makes a scan model for a map and a lidar."""

    def made(self, floor_plan: Map, lidar: Lidar) -> ScanModel:
        """Return the model of scans by this lidar on this map."""


OUTSIDE = -30.0
_BLOCK = 8192  # poses per block: their exact ranges fit the processor's cache


def in_blocks(told: Callable[[Singles], Floats], states: Singles) -> Floats:
    """Return what is told of poses (3, n), (n,), so many at a time."""
    starts = range(0, max(1, states.shape[1]), _BLOCK)
    return np.concatenate([told(states[:, start : start + _BLOCK]) for start in starts])


@dataclass(frozen=True, kw_only=True)
class LidarScan:
    """Log p(o_t | x_t, m) = Σ over usable beams of log p(o | ô), ô by ray casting.

    A beam that is NaN, infinite or outside [0, max_range] is skipped; a scan without a usable beam
    has log-likelihood 0. Rays start at the lidar's mounts; if a beam of one that is outside the
    outer wall is used, each counts -30 or less.
    """

    floor_plan: Map
    lidar: Lidar
    beam: BeamDensity

    def __post_init__(self) -> None:
        verbs = ("log_likelihood", "least_density")
        if lacking := [verb for verb in verbs if not callable(getattr(self.beam, verb, None))]:
            raise InputError(
                f"the beam model is of type {type(self.beam).__name__}, without "
                f"{' and '.join(lacking)}: a beam model has log_likelihood(ranges, expected, "
                "max_range) and least_density(max_range)."
            )

    def log_likelihood(self, states: Singles, scan: Scan) -> Floats:
        """Log-likelihood of a scan at each pose (3, n), (n,)."""
        if states.shape[1] > _BLOCK:
            return in_blocks(partial(self.log_likelihood, scan=scan), states)
        if scan.beams == 0:
            return np.zeros(states.shape[1])
        return self.weighed(*self.compared(states, scan))

    def compared(self, states: Singles, scan: Scan) -> tuple[Floats, Singles]:
        """Usable ranges, (B,), and the exact ones at each pose (3, n), NaN outside, (B, n)."""
        measured, used = scan.ranges, None
        if scan.beams < measured.size:
            measured, used = measured[scan.usable], scan.usable
        expected = np.empty((measured.size, states.shape[1]), np.float32)
        self.lidar.cast(self.floor_plan.cast, states, expected, used)
        if len(self.lidar.places) > 1:  # a pose is outside if one of its mounts is
            expected[:, np.isnan(expected).any(axis=0)] = np.nan
        return measured, expected

    def weighed(self, measured: Floats, expected: Singles) -> Floats:
        """Log-likelihood of usable ranges (B,), one or more, given the exact ones, (B, n), (n,)."""
        out = self.beam.log_likelihood(measured, expected.T, self.lidar.max_range)
        out[np.isnan(expected[0])] = measured.size * self._outside
        return out

    def at(self, states: Singles) -> Callable[[Scan], Floats]:
        """Return ``log_likelihood`` at fixed poses (3, n), whose rays are cast once."""
        all_beams = Scan.of(np.zeros(self.lidar.beams), self.lidar.max_range)
        return partial(self._weighed_at, self.compared(states, all_beams)[1])

    def _weighed_at(self, expected: Singles, scan: Scan) -> Floats:
        if scan.beams == 0:
            return np.zeros(expected.shape[1])
        if scan.beams == scan.ranges.size:
            return self.weighed(scan.ranges, expected)
        return self.weighed(scan.ranges[scan.usable], expected[scan.usable])

    @cached_property
    def _outside(self) -> float:
        return log_outside(self.beam, self.lidar.max_range)


def log_outside(beam: BeamDensity, max_range: float) -> float:
    """Least of -30 and of a beam's log-density: no scan is likelier outside than inside."""
    return min(OUTSIDE, float(arrays.log(beam.least_density(max_range))))
