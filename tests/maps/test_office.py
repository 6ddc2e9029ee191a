"""Generated offices: one piece, through doors, alike where they say so, the same everywhere."""

import hashlib

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from deqmcl_gym import Office
from deqmcl_gym.maps.office import CELL

RADIUS = 0.3  # m


@st.composite
def offices(draw, **fixed):
    given = {
        "seed": draw(st.integers(0, 2**32)),
        "wings": draw(st.integers(1, 3)),
        "corridors": draw(st.integers(1, 2)),
        "corridor": draw(st.integers(8, 50)) / 10,
        "door": draw(st.integers(7, 15)) / 10,
        "repeated": draw(st.booleans()),
    }
    return Office(**given | fixed)


@settings(max_examples=15)
@given(offices())
def test_a_robot_comes_through_the_doors_to_all_that_is_free(office):
    # its disc goes from cell to cell; what it covers, corners filled up, is all that is free
    grid = office.grid
    rows, columns = grid.solid.shape
    places = grid.placed([(c + 0.5, r + 0.5) for r in range(rows) for c in range(columns)])
    fits = grid.free(places, RADIUS)
    numbers = np.arange(fits.size).reshape(rows, columns)
    above = [numbers[:-1].ravel(), numbers[1:].ravel()]
    pairs = np.hstack([above, [numbers[:, :-1].ravel(), numbers[:, 1:].ravel()]])
    pairs = pairs[:, fits[pairs].all(axis=0)]
    pairs = pairs[:, ~grid.collides(places[pairs[0]], places[pairs[1]], RADIUS)]
    graph = coo_array((np.ones(pairs.shape[1]), pairs), shape=(fits.size, fits.size))
    assert np.unique(connected_components(graph)[1][fits]).size == 1
    covered = cv2.dilate(fits.reshape(rows, columns).astype(np.uint8), np.ones((7, 7), np.uint8))
    assert covered[~grid.solid].all()


@settings(max_examples=15)
@given(
    offices(repeated=False, symmetric=True, wings=2)
    | offices(repeated=False, symmetric=True, wings=4)
)
def test_a_half_turn_of_a_symmetric_office_is_the_same_office(office):
    assert (office.grid.solid == office.grid.solid[::-1, ::-1]).all()


@settings(max_examples=15)
@given(offices(repeated=True))
def test_wings_of_an_office_that_repeats_them_are_alike(office):
    solid = office.grid.solid[:, 2:-2]  # without the outer walls, and with a corridor left over
    period = (solid.shape[1] - round(office.corridor / CELL)) // office.wings
    for wing in range(1, office.wings):
        assert (solid[:, wing * period : (wing + 1) * period] == solid[:, :period]).all()


def test_other_seeds_are_other_buildings():
    seen = {Office(seed=seed).grid.digest for seed in range(50)}
    assert len(seen) == 50


def test_a_seed_gives_the_same_building_on_every_machine():
    solid = np.concatenate([Office(seed=seed, wings=3).grid.solid.ravel() for seed in range(10)])
    assert hashlib.sha256(np.packbits(solid).tobytes()).hexdigest()[:16] == "80770a54054f8111"
