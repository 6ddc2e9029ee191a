"""Maps in files: what map_server's rules make of hand-written bytes, the way back, refusals."""

import contextlib
import math
import os
from dataclasses import replace

import numpy as np
import pytest
from grid_cases import grids
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from refusals import refused

from deqmcl_gym.maps import GridMap
from deqmcl_gym.validation import InputError
from deqmcl_gym.world import WORLDS

YAML = """image: {image}
resolution: {resolution}
origin: {origin}
negate: {negate}
occupied_thresh: {occupied}
free_thresh: {free}
"""
# 3 wide, 2 high; the first row is the upper one
PGM = b"P5\n# drawn by hand\n3 2\n255\n" + bytes([0, 254, 205, 254, 128, 255])
NEEDED = ["image", "resolution", "origin", "negate", "free_thresh"]


def written(folder, image=PGM, name="map.pgm", more="", **said):
    values = {"image": name, "resolution": 0.05, "origin": [0, 0, 0.0]}
    values |= {"negate": 0, "occupied": 0.65, "free": 0.196} | said
    if isinstance(image, bytes):
        (folder / name).write_bytes(image)
    elif image is not None:
        Image.fromarray(np.asarray(image, np.uint8)).save(folder / name)
    path = folder / "map.yaml"
    path.write_text(YAML.format(**values) + more)
    return path


def test_a_hand_written_pgm_is_read_as_map_server_reads_it_negated_too(tmp_path):
    grid = GridMap.load(written(tmp_path, origin=[1.5, -2, 0.25], resolution="5e-2"))
    assert grid.occupancy.tolist() == [[0, -1, 0], [100, 0, -1]]  # the lowest row first
    assert (grid.resolution, grid.origin) == (0.05, (1.5, -2.0, 0.25))
    assert (grid.occupied_thresh, grid.free_thresh) == (0.65, 0.196)
    far = math.hypot(0.15, 0.1), math.atan2(0.1, 0.15) + 0.25
    corner = [1.5 + far[0] * math.cos(far[1]), -2 + far[0] * math.sin(far[1])]
    np.testing.assert_allclose(grid.placed([(3, 2)]), [corner])
    turned = GridMap.load(written(tmp_path, negate=1))
    assert turned.occupancy.tolist() == [[100, -1, 100], [0, 100, 100]]


def test_scale_keeps_what_lies_between_and_raw_takes_the_values(tmp_path):
    shades = [[254, 205, 150, 100, 0], [254] * 5]
    scaled = GridMap.load(written(tmp_path, shades, more="mode: scale\n"))
    between = [round(100 * (1 - s / 255 - 0.196) / 0.454) for s in (205, 150, 100)]
    assert scaled.occupancy[1].tolist() == [0, *between, 100]
    raw = GridMap.load(written(tmp_path, [[0, 40, 100, 101, 255], [0] * 5], more="mode: raw\n"))
    assert raw.occupancy[1].tolist() == [0, 40, 100, -1, -1]
    assert raw.solid[1].tolist() == [False, False, True, True, True]


@pytest.mark.parametrize(
    "kind", ["L.pgm", "L.bmp", "L.png", "RGB.png", "RGBA.png", "LA.png", "P.png", "16.png"]
)
def test_the_kind_of_image_does_not_matter(tmp_path, kind):
    shades = np.array([[0, 254, 205], [254, 128, 255]], np.uint8)
    image, mode = Image.fromarray(shades), kind.partition(".")[0]
    deep = Image.fromarray(shades.astype(np.uint16) * 257)
    image = deep if mode == "16" else image.convert(mode)
    image.save(tmp_path / kind)
    grid = GridMap.load(written(tmp_path, None, kind))
    # map_server counts alpha as one colour of four in mode trinary: 205 becomes 217.5
    grey = 0 if mode.endswith("A") else -1
    assert grid.occupancy.tolist() == [[0, -1, 0], [100, 0, grey]]


@pytest.mark.parametrize("mode", ["L", "RGB", "P"])
def test_a_transparent_colour_or_cell_is_unknown_in_mode_scale(tmp_path, mode):
    shades = Image.fromarray(np.array([[0, 254], [100, 254]], np.uint8)).convert(mode)
    clear = shades.getpixel((0, 1))
    shades.save(tmp_path / "x.png", transparency=clear)
    grid = GridMap.load(written(tmp_path, None, "x.png", more="mode: scale\n"))
    assert grid.occupancy.tolist() == [[-1, 0], [100, 0]]
    pixels = np.array([[[254, 255], [0, 255]], [[254, 0], [254, 255]]], np.uint8)
    grid = GridMap.load(written(tmp_path, pixels, "map.png", more="mode: scale\n"))
    assert grid.occupancy.tolist() == [[-1, 0], [0, 100]]


def test_a_map_larger_than_pillow_trusts_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 2)
    monkeypatch.setattr("deqmcl_gym.maps.grid_file._BLOCK", 1)  # of one row each
    assert GridMap.load(written(tmp_path)).occupancy.tolist() == [[0, -1, 0], [100, 0, -1]]


@settings(max_examples=60)
@given(grids(), st.sampled_from([(0.196, 0.65), (0.25, 0.65), (0.4, 0.9)]))
def test_a_saved_map_is_read_back_as_it_was(tmp_path_factory, grid, thresholds):
    path = tmp_path_factory.mktemp("map") / "office.yaml"
    given_map = replace(grid, free_thresh=thresholds[0], occupied_thresh=thresholds[1])
    given_map.save(path)
    back = GridMap.load(path, given_map.unknown)
    assert (back.resolution, back.origin) == (grid.resolution, grid.origin)
    np.testing.assert_array_equal(back.occupancy, given_map.occupancy)


@pytest.mark.parametrize(
    ("unknown", "solid"),
    [("obstacle", True), ("transparent", True), ("free", False), (0.7, True), (0.5, False)],
)
def test_what_unknown_cells_count_as_is_chosen_where_the_map_is_read(tmp_path, unknown, solid):
    given_plan = {"file": str(written(tmp_path)), "unknown": unknown}
    grid = WORLDS["paper"].changed(floor_plan=given_plan).floor_plan
    assert grid is GridMap.load(tmp_path / "map.yaml", unknown=unknown)
    assert grid.solid.tolist() == [[False, solid, False], [True, False, solid]]
    assert grid.occupied.tolist() == [[False, False, False], [True, False, False]]


def test_a_file_is_read_once_until_it_changes(tmp_path):
    path = written(tmp_path)
    grid = GridMap.load(path)
    assert GridMap.load(path) is grid
    assert GridMap.load(path, unknown="free") is not grid
    (tmp_path / "map.pgm").write_bytes(PGM[:-1] + bytes([0]))
    os.utime(tmp_path / "map.pgm", ns=(1, 1))
    assert GridMap.load(path).occupancy.tolist() == [[0, -1, 100], [100, 0, -1]]
    (tmp_path / "other.pgm").write_bytes(PGM[:-1] + bytes([205]))
    os.utime(tmp_path / "other.pgm", ns=(1, 1))
    (tmp_path / "other.pgm").replace(tmp_path / "map.pgm")  # of the same size and time
    assert GridMap.load(path).occupancy.tolist() == [[0, -1, -1], [100, 0, -1]]


BROKEN = {
    "names the image lost.pgm, but there is no file": {"name": "lost.pgm", "image": None},
    "is broken": {"image": PGM[:-2]},
    "neither a pgm, a png nor a bmp": {"image": b"GIF89a, or so"},
    "unknown mode 'trinity': did you mean 'trinary'": {"more": "mode: trinity"},
    "resolution is 0, but must be a number above 0": {"resolution": 0},
    "origin is [0, 0], but must be [x, y, yaw]": {"origin": [0, 0]},
    "heading must be in radians": {"origin": [0, 0, 90]},
    "negate is 2, but must be 0 or 1": {"negate": 2},
    "free_thresh must be the smaller": {"free": 0.7},
    "occupied_thresh is 65, but must be a number above 0 to 1": {"occupied": 65},
    "is not YAML": {"more": "mode: [trinary"},
    "has the key 'resolution' twice": {"more": "resolution: 0.5"},
    "found unhashable key": {"more": "? [1]\n: 2"},
    "has an alias, which is not taken": {"more": "a: &a [1]\nb: [*a, *a]"},
    "is nested too deeply": {"more": "a: " + "[" * 900 + "]" * 900},
    "has 2x2 pixels of mode F": {"image": b"Pf\n2 2\n-1\n" + bytes(16)},
    "has 1 x 1 cells, but must have from 2": {"image": b"P5\n1 1\n255\n\xfe"},
    "no free cell: 0 of 6 are occupied and 6 unknown": {"image": PGM[:-6] + bytes([205] * 6)},
    "single precision tells apart 0.25 m": {"origin": [4e6, 0, 0]},
    "but there is no file": {"name": "a" * 300, "image": None},
}


@pytest.mark.parametrize("sentence", BROKEN)
def test_a_broken_map_is_refused_in_one_sentence_that_names_it(tmp_path, sentence):
    case = {"name": "map.pgm", "image": PGM} | BROKEN[sentence]
    path = written(tmp_path, **case)
    with refused(sentence, str(tmp_path)):
        GridMap.load(path)


@pytest.mark.parametrize("name", ["map.yaml", "map.json"])
def test_a_pipe_is_not_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with refused("is a named pipe"):
        WORLDS["paper"].changed(floor_plan=tmp_path / name)


@pytest.mark.parametrize("missing", NEEDED)
def test_a_yaml_without_what_map_server_needs_is_refused(tmp_path, missing):
    path = written(tmp_path)
    lines = [line for line in path.read_text().splitlines() if not line.startswith(missing)]
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=f"has no {missing}, but needs"):
        GridMap.load(path)


@settings(max_examples=100)
@given(st.binary(max_size=60), st.integers(0, 60))
def test_an_image_of_any_bytes_is_read_or_refused(tmp_path_factory, junk, cut):
    path = written(tmp_path_factory.mktemp("map"), PGM[:cut] + junk)
    with contextlib.suppress(InputError):
        GridMap.load(path)


@settings(max_examples=100)
@given(st.text(max_size=40), st.sampled_from(NEEDED))
def test_a_yaml_of_any_values_is_read_or_refused(tmp_path_factory, junk, key):
    path = written(tmp_path_factory.mktemp("map"))
    before = path.read_text().splitlines()
    lines = [f"{key}: {junk}" if line.startswith(key) else line for line in before]
    path.write_text("\n".join(lines), encoding="utf-8")
    with contextlib.suppress(InputError):
        GridMap.load(path)


def test_a_map_that_cannot_be_written_is_refused(tmp_path):
    grid = GridMap(occupancy=np.zeros((2, 2), int), resolution=0.05)
    with pytest.raises(InputError, match="cannot be written"):
        grid.save(written(tmp_path) / "map.yaml")  # a file, no folder


@pytest.mark.parametrize("percent", range(2, 100, 7))
def test_a_cell_at_the_threshold_is_solid_where_it_is_asked_saved_or_drawn(tmp_path, percent):
    cells = np.array([[0, percent], [percent - 1, 0]])
    grid = GridMap(occupancy=cells, resolution=0.1, free_thresh=0.01, occupied_thresh=percent / 100)
    grid.save(tmp_path / "map.yaml")
    again = GridMap.load(tmp_path / "map.yaml", unknown="free")
    assert grid.solid.tolist() == again.solid.tolist() == [[False, True], [False, False]]
