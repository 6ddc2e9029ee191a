"""Pairs of normal numbers from one uniform number each, by Box and Muller; at the ends too."""

import numpy as np
import pytest

from localizers.models import motion_kernels as kernels


def pairs(uniforms: np.ndarray) -> np.ndarray:
    out = np.empty((2, uniforms.size), np.float32)
    kernels.normal_pairs(uniforms, 0.0, 1.0, 0.0, 1.0, out)
    return out.astype(np.float64)


def test_a_pair_is_box_and_mullers_formula():
    uniforms = np.random.default_rng(1).random(10_000)
    scaled = uniforms * 2**24
    radius = np.sqrt(-2 * np.log((np.floor(scaled) + 0.5) / 2**24))
    angle = 2 * np.pi * (scaled % 1)
    # float32: the argument of the logarithm is off by 6e-8, the radius by that over itself, at
    # least 0.01 here; the angle by 4e-7 rad, the radius at most 5.9
    expected = radius * np.array([np.cos(angle), np.sin(angle)])
    assert np.abs(pairs(uniforms) - expected).max() < 1e-5


def test_the_least_and_the_largest_uniform_number_make_finite_pairs():
    ends = pairs(np.array([0.0, 1 - 2**-53]))
    assert ends[0, 0] == pytest.approx(np.sqrt(2 * np.log(2**25)), rel=1e-6)
    assert np.isfinite(ends).all()
