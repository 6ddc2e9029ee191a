"""``python training_data.py``: what is written is what the rooms were."""

import numpy as np
import pytest
from refusals import refused
from training_data import main, recorded

from deqmcl_gym.maps import Office

BUILDINGS, STEPS, ROOMS, CROP = (40, 43), 30, 4, 32


@pytest.fixture(scope="module")
def data():
    return recorded(BUILDINGS, STEPS, rooms=ROOMS, crop=CROP)


def test_every_scan_is_that_of_its_pose_in_its_building(data):
    for step, room in np.ndindex(STEPS, ROOMS):
        plan = Office(seed=int(data["building"][step, room])).grid
        exact = plan.ranges([data["pose"][step, room]], data["bearings"])[0]
        seen = data["scan"][step, room]
        assert np.allclose(data["expected"][step, room], exact, atol=1e-3)
        both = np.isfinite(seen) & np.isfinite(exact) & (exact < 6.0)
        assert np.all(np.abs(seen - exact)[both] < 6 * 0.5)  # σ = 0.5 m: one of 5e8 is farther off


def test_a_scenario_without_offices_or_with_people_is_refused():
    with refused("'sharp' does not take place in generated offices"):
        recorded(BUILDINGS, 5, scenario="sharp")
    with refused("'wrong-map' has people"):
        recorded(BUILDINGS, 5, scenario="wrong-map")


def test_commands_lead_from_pose_to_pose_and_are_0_where_an_episode_begins(data):
    begins = data["begins"]
    assert begins[0].all()
    assert not data["command"][begins].any()
    moved = np.linalg.norm(np.diff(data["pose"][..., :2], axis=0), axis=-1)
    told = data["command"][1:, :, 0]
    # noise is 2 % of the drive: six standard deviations; a contact may stop the robot before
    assert np.all((moved <= 1.12 * told + 1e-6) | begins[1:])


def test_the_same_seed_is_the_same_data_from_the_buildings_that_were_asked_for(data):
    again = recorded(BUILDINGS, STEPS, rooms=ROOMS, crop=CROP)
    assert all(np.array_equal(data[name], again[name]) for name in data)
    assert set(np.unique(data["building"])) <= set(range(*BUILDINGS))


def test_the_command_writes_one_file_and_refuses_what_is_no_range(tmp_path, capsys):
    file = tmp_path / "data.npz"
    main(["--buildings", "40:42", "--steps", "3", "--rooms", "2", "--out", str(file)])
    assert np.load(file)["scan"].shape == (3, 2, 16)
    assert "6 scans in" in capsys.readouterr().out
    with refused("--buildings is '40'"):
        main(["--buildings", "40", "--out", str(file)])
    with refused("--crop is 33"):
        main(["--crop", "33", "--out", str(file)])
