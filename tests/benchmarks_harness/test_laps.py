"""Which trials are run again for the animations, and beside whom."""

import io
from dataclasses import replace

import PIL.Image
from report_cases import finished

from benchmarks.report.animations import animations_of
from benchmarks.sweeps.drawing import Animation, drawing
from benchmarks.tables.panels import panels
from benchmarks.trials.plugins import key_of
from benchmarks.trials.spec import Trial

# without mcl the first method is the baseline: here a variant of the same localizer
FORMS = ("systematic", "stratified")

ALONE = """
import sys
from localizers import make

assert not hasattr(sys, "guest"), f"{sys.guest} was here"
sys.guest = __file__

def Guest(robot):
    return make("dead-reckoning", robot)
"""


def shown(lap):
    """Resampler, world and filter seed of the trials of an animation, side by side."""
    return [(dict(t.params)["resampler"], t.trial, t.filter_seed) for t in lap.trials]


def form(resampler, world, error, filter_seed=0):
    return finished("mcl-h", world, error, params={"resampler": resampler}, filter_seed=filter_seed)


def chosen(records):
    (panel,) = panels(records)
    return animations_of(panel)


def test_variants_of_one_localizer_are_animated_each_by_its_own_first_trial():
    records = [
        form(one, world, 1.0 + i + world, seed)
        for seed in (0, 1)
        for i, one in enumerate(FORMS)
        for world in (0, 1)
    ]
    best, *_ = chosen(records)
    assert shown(best) == [("systematic", 0, 0), ("stratified", 0, 0)]
    assert "mcl-h resampler=systematic and mcl-h resampler=stratified" in best.caption


def test_a_baseline_without_a_trial_on_the_world_is_not_named():
    records = [form("systematic", 1, 1.0), form("stratified", 1, 3.0), form("stratified", 0, 2.0)]
    best, *_ = chosen(records)
    assert shown(best) == [("stratified", 0, 0)]
    assert best.caption.startswith("World 0, mcl-h resampler=stratified: error")


def test_plug_ins_of_one_animation_do_not_meet(tmp_path):
    names = [str(tmp_path / f"{one}.py:Guest") for one in ("one", "other")]
    for one in ("one", "other"):
        (tmp_path / f"{one}.py").write_text(ALONE)
    same = Trial(scenario="paper", localizer="", params=(), lag=1, seed=0, trial=0)
    trials = tuple(replace(same, localizer=name) for name in names)
    keys = tuple(map(key_of, trials))
    lap = Animation(name="lap", title="", caption="", trials=trials, labels=("a", "b"), keys=keys)
    with drawing() as promised:
        drawn = promised(lap)()
    animation = PIL.Image.open(io.BytesIO(drawn.webp))
    assert animation.n_frames == 204 // 8 + 1 + 1  # and the whole way
    assert animation.width > 2 * 350  # side by side
