"""What a floor plan may be given as, and that all forms of one building are the same."""

import os

import pytest

from deqmcl_gym import GridMap, Office, PolygonMap
from deqmcl_gym.maps import polygon_file
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.config import WORLDS

OFFICE = Office(seed=3, wings=1)


def floor_plan(given):
    return WORLDS["paper"].changed(floor_plan=given).floor_plan


def test_an_office_is_a_floor_plan_of_cells_or_of_polygons():
    said = {"seed": 3, "wings": 1}
    for given in (OFFICE, {"office": said}, {"office": OFFICE}, {"office": said, "form": "grid"}):
        assert floor_plan(given) is OFFICE.grid
    assert floor_plan({"office": said, "form": "polygons"}) is OFFICE.polygons
    assert isinstance(OFFICE.grid, GridMap)
    assert isinstance(OFFICE.polygons, PolygonMap)


def test_polygons_in_a_file_are_read_back_as_they_were(tmp_path):
    path = tmp_path / "office.json"
    path.write_text(polygon_file.text_of(OFFICE.polygons))
    for given in (path, str(path), {"file": str(path)}):
        assert floor_plan(given) == OFFICE.polygons


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"office": {"sed": 3}}, "did you mean 'seed'"),
        ({"office": 3}, "floor_plan.office is 3"),
        ({"office": {}, "frm": 1}, "did you mean 'form'"),
        ({"office": {}, "form": "x"}, "allowed values: grid, polygons"),
        ({"offic": {}}, "did you mean 'office'"),
        ({"file": "a.json", "unknown": "free"}, "unknown key in floor_plan 'unknown'"),
        ("nowhere.json", "does not exist"),
        (3, "floor_plan is 3, but must be a map"),
    ],
)
def test_what_is_no_floor_plan_is_refused(given, words):
    with pytest.raises(InputError, match=words):
        floor_plan(given)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is truncated, or not JSON"),
        ("[]", "is not a JSON object"),
        ('{"unit": "m"}', "the outer wall is None"),
        ('{"outer": [[0, 0]], "walls": 3}', "unknown key 'walls'"),
        ('{"outer": [[0, 0], [1, 0]], "unit": "m"}', "has 2 corners"),
        ('{"outer": [], "file": "a.json"}', "unknown key 'file'"),
        ("\xff", "is not UTF-8"),
    ],
)
def test_a_broken_file_of_polygons_is_refused_by_name(tmp_path, text, words):
    path = tmp_path / "broken.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=words) as refusal:
        floor_plan(path)
    assert "broken.json" in str(refusal.value)


def test_a_pipe_is_no_map_and_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "map.json")
    with pytest.raises(InputError, match="is a named pipe"):
        floor_plan(tmp_path / "map.json")
