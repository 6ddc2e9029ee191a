"""Animations: which trials they show, and what is to be seen in each frame and at the end."""

import io
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import PIL.Image
import pytest
from fake_episode import FakeBelief
from report_cases import finished, panel_of

from benchmarks.execution.processes import Processes
from benchmarks.report import films
from benchmarks.report.films import Animation, Camera, Film, films_of, way_of_plan
from benchmarks.trials.episode import Step
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import key_of
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.world.drawing import View

HALL = PolygonMap(outer=[(0, 0), (60, 0), (60, 40), (0, 40)], unit="m")
BLUE, GREEN, GRAY, ORANGE = (0, 114, 178), (0, 158, 115), (128, 128, 128), (255, 140, 0)
STEPS, FOUND = 12, 7


def episode(rng):
    """A drive along y = 10 with 20,000 particles, anywhere until they are at the truth."""
    for step in range(STEPS + 1):
        truth = np.array([10.0 + step, 10.0, 0.0])
        wrong = np.array([40.0, 30.0, 0.0])
        cloud = (truth if step >= FOUND else wrong) + rng.normal(0, 0.3, (20_000, 3))
        belief = FakeBelief({0: (cloud, np.full(20_000, 1 / 20_000))})
        plan = np.array([[1.0, 0.0]] * 20)
        action = np.array([1.0, 0.0]) if step else None
        yield Step(step, truth, np.empty(0), belief, 0.0, action, plan)


def filmed():
    film = Film(Camera(View(HALL, 0.2), 0.25, 0), "mcl", 4)
    assert len(list(film.of(episode(np.random.default_rng(0))))) == STEPS + 1
    return film


def has(image, color, place, within=8):
    """Whether a colour is to be seen near a place of the hall."""
    column, row = np.rint(View(HALL, 0.2).pixels([place])[0]).astype(int)
    seen = image[row - within : row + within + 1, column - within : column + within + 1]
    return (np.abs(seen.astype(int) - color) < 60).all(axis=-1).any()  # thin lines are blended


def test_every_frame_shows_truth_best_cluster_cloud_and_plan_in_a_building():
    film = filmed()
    assert len(film.frames) == 4 + 1
    assert len({frame.shape for frame in film.frames}) == 1
    for step, frame in zip((0, 4, 8, 12, 12), film.frames, strict=True):
        x = 10 + step
        believed = (x, 10) if step >= FOUND else (40, 30)
        assert has(frame, GRAY, (x, 10))
        assert has(frame, BLUE, believed)
        assert has(frame, ORANGE, believed)
        assert has(frame, GREEN, (x + 15, 10))
        assert not has(frame, GREEN, (x + 25, 10))


def test_the_last_frame_has_the_way_of_the_best_cluster():
    *_, before, last = filmed().frames
    assert has(last, BLUE, (40, 30))
    assert not has(before, BLUE, (40, 30))


def test_a_plan_is_laid_from_a_pose_by_turning_before_each_drive():
    way = way_of_plan(
        np.array([1.0, 2.0, math.pi / 2]), np.array([[2.0, 0.0], [1.0, -math.pi / 2]])
    )
    assert way == pytest.approx(np.array([[1, 2], [1, 4], [2, 4]]))


# without mcl the first method is the baseline: here a variant of the same localizer
FORMS = ("systematic", "stratified")


def shown(lap):
    """Resampler, world and filter seed of the trials of an animation, side by side."""
    trials = [run.trial for run in lap.runs.values()]
    return [(dict(t.params)["resampler"], t.trial, t.filter_seed) for t in trials]


def form(resampler, world, error, filter_seed=0):
    return finished(
        "mcl-pilots", world, error, params={"resampler": resampler}, filter_seed=filter_seed
    )


def test_variants_of_one_localizer_are_animated_each_by_its_own_first_trial():
    records = [
        form(one, world, 1.0 + i + world, seed)
        for seed in (0, 1)
        for i, one in enumerate(FORMS)
        for world in (0, 1)
    ]
    best, *_ = films_of(panel_of(records))
    assert shown(best) == [("systematic", 0, 0), ("stratified", 0, 0)]
    assert "mcl-pilots resampler=systematic and mcl-pilots resampler=stratified" in best.caption


def test_a_baseline_without_a_trial_on_the_world_is_not_named():
    records = [form("systematic", 1, 1.0), form("stratified", 1, 3.0), form("stratified", 0, 2.0)]
    best, *_ = films_of(panel_of(records))
    assert shown(best) == [("stratified", 0, 0)]
    assert best.caption.startswith("World 0, mcl-pilots resampler=stratified: error")


def lap_of(*trials):
    runs = [SimpleNamespace(trial=trial, key=key_of(trial)) for trial in trials]
    return Animation(name="lap", title="", caption="", runs=dict(zip("ab", runs, strict=True)))


def test_an_animation_shows_the_whole_way_of_each_method_side_by_side():
    same = Trial(scenario="paper", localizer="mcl", params=(), lag=1, seed=0, trial=0)
    lap = lap_of(same, replace(same, localizer="dead-reckoning"))
    with Processes(1) as pool:
        drawn = pool.submit(films.filmed, lap).result()
    animation = PIL.Image.open(io.BytesIO(drawn.webp))
    assert animation.n_frames == 204 // 8 + 1 + 1  # and the whole way
    assert animation.width > 2 * 350  # side by side


def test_a_hedge_is_animated_beside_a_method_that_sees_no_plan():
    same = Trial(
        scenario="guided", localizer="mcl", params={"particles": 20}, lag=0, seed=0, trial=0
    )
    lap = lap_of(same, replace(same, localizer="mcl-plan-hedged"))
    assert films.filmed(lap).webp.startswith(b"RIFF")
