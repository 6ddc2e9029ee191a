"""The figures of ``deqmcl paper``: what is in the picture, by its colours."""

import math

import cv2
import numpy as np
import pytest
from deqmcl_command import exit_code, files

from benchmarks.pictures.figures import camera_of, write_figures
from benchmarks.pictures.frames import Camera
from benchmarks.sweeps.suites import paper_suite
from benchmarks.trials.attempt import trial_trace
from benchmarks.trials.episode import trial_moments

COLOURS = {  # by eye: what a reader would call so, R, G, B
    "black": lambda r, g, b: (r < 60) & (g < 60) & (b < 60),
    "gray": lambda r, g, b: (abs(r - 128) < 12) & (abs(g - 128) < 12) & (abs(b - 128) < 12),
    "orange": lambda r, g, b: (r > 240) & (g > 110) & (g < 170) & (b < 40),
    "pink": lambda r, g, b: (r > 200) & (g < 130) & (b > 120) & (b < 200),
    "light blue": lambda r, g, b: (r < 130) & (g > 150) & (b > 210),
}
STRIP = 56  # rows below the room, for words
MARGIN, SCALE = 8, 2


def read(path):
    """An RGB image, in integers that do not wrap."""
    return cv2.imread(str(path))[:, :, ::-1].astype(int)


def room_of(image):
    return image[:-STRIP]


def where(image, colour):
    return COLOURS[colour](image[:, :, 0], image[:, :, 1], image[:, :, 2])


def count(image, colour):
    return int(where(image, colour).sum())


@pytest.fixture(scope="module")
def figures(small_run):
    return small_run[1] / "figures"


@pytest.mark.parametrize("name", ["fig4_deq-mcl", "fig4_mcl", "fig5_step150", "fig5_step170"])
def test_pictures_have_even_sizes_and_show_the_whole_room(figures, name):
    height, width, _ = read(figures / f"{name}.png").shape
    assert (width % 2, height % 2) == (0, 0)
    assert (width, height) == (350 * SCALE + 2 * MARGIN, 300 * SCALE + 2 * MARGIN + STRIP)


@pytest.mark.parametrize("name", ["fig4_deq-mcl", "fig5_step150", "fig5_step170"])
@pytest.mark.parametrize("colour", COLOURS)
def test_a_picture_of_deq_mcl_has_walls_robot_present_past_and_future(figures, name, colour):
    image = read(figures / f"{name}.png")
    assert count(room_of(image), colour) >= 9  # one dot of a cloud
    assert count(image[-STRIP:], colour) >= 9  # and its words or its dot in the legend


@pytest.mark.parametrize("colour", ["black", "gray", "orange"])
def test_the_picture_of_mcl_has_walls_robot_and_present(figures, colour):
    assert count(room_of(read(figures / "fig4_mcl.png")), colour) >= 9


@pytest.mark.parametrize("colour", ["pink", "light blue"])
def test_the_picture_of_mcl_shows_neither_past_nor_future_nor_speaks_of_them(figures, colour):
    assert count(read(figures / "fig4_mcl.png"), colour) == 0


def test_walls_are_black_and_stand_where_they_are(figures):
    image = read(figures / "fig4_mcl.png")
    for x, y in [(0, 100), (350, 200), (100, 0), (100, 300), (100, 150), (250, 150), (175, 200)]:
        assert where(image, "black")[MARGIN + SCALE * (300 - y), MARGIN + SCALE * x], (x, y)
    assert image[MARGIN + SCALE * 20, MARGIN + SCALE * 330].tolist() == [255, 255, 255]


def test_the_robot_is_drawn_at_the_truth_of_the_same_step_of_trial_0_for_both_methods(figures):
    (trial,) = paper_suite(
        scenario="paper", localizers=["dead-reckoning"], trials=1, seed=0, lag=20
    )
    truths = [moment.truth for moment in trial_moments(trial)]
    x, y, _ = truths[102]  # half-way round
    rows, columns = np.mgrid[: 300 * SCALE + 2 * MARGIN, : 350 * SCALE + 2 * MARGIN]
    apart = np.hypot(columns - MARGIN - SCALE * x, rows - MARGIN - SCALE * (300 - y))
    for name in ("fig4_mcl", "fig4_deq-mcl"):
        gray = where(room_of(read(figures / f"{name}.png")), "gray")
        gray &= apart < 40  # elsewhere: softened edges of letters
        assert apart[gray].max() <= SCALE * 8 + 1  # its radius is 8 px
        # the disc less its outline and heading line, which are black
        assert gray.sum() >= 0.6 * math.pi * (SCALE * 8) ** 2


def test_the_step_number_stands_at_the_top_left(figures):
    corner = (slice(MARGIN + 6, MARGIN + 34), slice(MARGIN + 6, MARGIN + 80))
    both = [read(figures / f"{name}.png")[corner] for name in ("fig4_mcl", "fig4_deq-mcl")]
    assert all(count(image, "black") > 50 for image in both)
    assert (where(both[0], "black") == where(both[1], "black")).all()  # the same step
    later = read(figures / "fig5_step150.png")[corner]
    assert (where(later, "black") != where(both[0], "black")).any()


def test_figure_5_prints_error_and_spread_beside_the_title(figures):
    title = slice(-STRIP, -STRIP // 2)
    words = {
        name: count(read(figures / f"{name}.png")[title], "black")
        for name in ("fig4_deq-mcl", "fig5_step150", "fig5_step170")
    }
    assert words["fig5_step150"] > 3 * words["fig4_deq-mcl"]
    assert words["fig5_step170"] > 3 * words["fig4_deq-mcl"]


def test_figure_5_tells_the_error_and_spread_of_state_150_as_scored(tmp_path, monkeypatch):
    (trial,) = paper_suite(
        scenario="paper", localizers=["deq-mcl"], trials=1, seed=0, lag=20, particles=30
    )
    notes, draw = {}, Camera.frame

    def noting(camera, moment, method, note=""):
        if note:
            notes[moment.step] = note
        return draw(camera, moment, method, note)

    monkeypatch.setattr(Camera, "frame", noting)
    write_figures([trial], tmp_path)
    trace = trial_trace(trial)
    expected = {}
    for step, offset in ((150, 0), (170, -20)):
        kept = trace.offsets[offset]
        at = kept.states.tolist().index(150)
        x, y, heading = trace.truth[150]
        error = math.dist(kept.means[at], (x, y, math.cos(heading), math.sin(heading)))
        spread = math.sqrt(kept.variances[at][0] + kept.variances[at][1])
        seen = f"error {error:.1f}, SD {spread:.1f} px"
        expected[step] = f"state 150 seen at step {step}: {seen}"
    assert notes == expected


def test_the_animation_shows_every_second_step_of_both_methods_side_by_side(figures):
    read_it, animation = cv2.imreadanimation(str(figures / "lap.webp"))
    assert read_it
    assert len(animation.frames) == 204 // 2 + 1
    assert animation.loop_count == 0  # for ever
    height, width = animation.frames[0].shape[:2]
    assert (width % 2, height % 2) == (0, 0)
    last = animation.frames[-1][:, :, 2::-1].astype(int)
    left, right = last[:, : width // 2], last[:, width // 2 :]
    assert count(left, "pink") == 0  # MCL
    assert count(right, "pink") >= 4  # DEQ-MCL
    assert count(left, "orange") >= 4
    assert count(right, "orange") >= 4


@pytest.mark.parametrize(
    ("lag", "names"),
    [
        (10, {"fig4_deq-mcl.png", "fig5_step150.png", "fig5_step160.png", "lap.webp"}),
        (0, {"fig4_deq-mcl.png", "fig5_step150.png", "lap.webp"}),
        (60, {"fig4_deq-mcl.png", "lap.webp"}),  # step 210 is never reached
    ],
)
def test_figure_5_looks_back_by_the_lag_it_was_given(tmp_path, capsys, lag, names):
    few = ("--trials", "1", "--particles", "10", "--localizers", "deq-mcl", "--jobs", "1")
    assert exit_code("paper", *few, "--lag", lag, "--out", tmp_path) == 0
    assert set(files(tmp_path / "figures")) == {*names, "drawn.json"}
    said = capsys.readouterr().out.splitlines()[-1]
    assert all(said.count(f"figures/{name}") == 1 for name in names)


def test_no_figure_is_promised_of_methods_that_were_not_run(tmp_path, capsys):
    few = ("--trials", "1", "--localizers", "dead-reckoning", "--jobs", "1")
    assert exit_code("paper", *few, "--out", tmp_path) == 0
    assert not (tmp_path / "figures").exists()
    assert "figures" not in capsys.readouterr().out


@pytest.mark.parametrize("scenario", ["paper", "matched", "sharp", "guided"])
@pytest.mark.parametrize("scale", [1.0, 1.2, 1.6, 2.0])
def test_every_frame_has_an_even_size(scenario, scale):
    (trial,) = paper_suite(
        scenario=scenario, localizers=["deq-mcl"], trials=1, seed=0, lag=2, particles=5
    )
    moment = next(iter(trial_moments(trial)))
    height, width, _ = camera_of(scenario, 2, scale).frame(moment, "deq-mcl").shape
    assert (width % 2, height % 2) == (0, 0)
