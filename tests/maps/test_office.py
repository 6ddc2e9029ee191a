"""Generated offices: connected through doors, and the same everywhere."""

import hashlib

import cv2
import numpy as np
import pytest

from deqmcl_gym.maps.office import CELL, Office
from deqmcl_gym.validation import InputError

KINDS = {
    "small": Office(wings=1, corridors=1),
    "large": Office(wings=4, corridors=3),
    "narrow": Office(corridor=0.9, door=0.7),
    "wide": Office(corridor=3.0, door=1.5),
    "repeated": Office(wings=3, repeated=True),
    "symmetric": Office(wings=4, symmetric=True),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(20))
def test_a_robot_that_fits_through_the_doors_reaches_every_room(kind, seed):
    office = KINDS[kind]
    free = office.cells(np.random.default_rng(seed)).astype(np.uint8)
    door = round(office.door / CELL)
    fits = cv2.erode(free, np.ones((door, door), np.uint8), anchor=(0, 0), borderValue=0)
    regions, _ = cv2.connectedComponents(free, connectivity=4)
    of_robot, _ = cv2.connectedComponents(fits, connectivity=4)
    assert regions == of_robot == 2  # walls, and the one free region
    # all that is free is swept by the robot, a square as wide as a door
    swept = cv2.dilate(fits, np.ones((door, door), np.uint8), anchor=(door - 1, door - 1))
    assert (swept == free).all()
    border = np.ones_like(free, dtype=bool)
    border[1:-1, 1:-1] = False
    assert not free[border].any()


def test_a_seed_gives_the_same_building_on_every_machine():
    cells = Office().cells(np.random.default_rng(3))
    digest = hashlib.sha256(np.packbits(cells).tobytes()).hexdigest()
    assert (cells.shape, digest[:16]) == ((234, 474), "674d1f2df240d43e")


def test_a_half_turn_of_a_symmetric_office_is_the_same_office():
    cells = KINDS["symmetric"].cells(np.random.default_rng(0))
    assert (cells == cells[::-1, ::-1]).all()


def test_wings_of_an_office_that_repeats_them_are_alike():
    three = KINDS["repeated"].cells(np.random.default_rng(0))
    period = (three.shape[1] - 20 - 4) // 3  # what is left are a corridor and the outer walls
    assert (three[:, 2 : 2 + period] == three[:, 2 + period : 2 + 2 * period]).all()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"wings": 0}, "wings is 0"),
        ({"wings": 3, "symmetric": True}, "give an even number"),
        ({"door": 0.1}, "door is 0.1"),
        ({"corridor": float("nan")}, "corridor is nan"),
    ],
)
def test_what_cannot_be_built_is_refused(given, words):
    with pytest.raises(InputError, match=words):
        Office(**given)
