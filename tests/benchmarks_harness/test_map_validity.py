"""Lost, or the map is wrong: what is kept of a trial, and how well signals tell."""

import math

import numpy as np
import pytest
from report_cases import STEPS, changed, finished

from benchmarks.setup.overrides import Overrides
from benchmarks.tables.panels import panels
from benchmarks.tables.signals import QUESTIONS, WRONG, maps_table
from benchmarks.trials.episode import Step
from benchmarks.trials.map_signals import MAP_COLUMNS, SIGNALS, MapSignals
from benchmarks.trials.scoring import record
from benchmarks.trials.spec import Trial
from benchmarks.trials.stage import Stage
from benchmarks.trials.trace import PLAN_COLUMNS
from deqmcl_gym.maps import Lidar, PolygonMap
from localizers import PointsBelief

HALL = PolygonMap(((0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)), unit="m")
LIDAR = Lidar(beams=36, field_of_view=2 * math.pi, max_range=30.0, sigma=0.0)
HERE, THERE, FAR = (3.0, 3.0, 0.0), (4.0, 3.0, 0.0), (9.0, 6.0, 2.0)


def rows(*steps, floor_plan=HALL):
    """The columns of steps of (believed pose, true pose, scan)."""
    signals = MapSignals(floor_plan, LIDAR)
    start = np.array(HERE)
    signals.see(Step(0, start, LIDAR.bearings, PointsBelief(start[None]), 0.0))
    for number, (best, truth, ranges) in enumerate(steps, 1):
        belief = PointsBelief(np.array([best]))
        signals.see(Step(number, np.array(truth), ranges, belief, 0.0))
    return signals.columns()


def seen(pose, floor_plan=HALL):
    return floor_plan.ranges([pose], LIDAR.bearings)[0]


def with_box(pose):
    """The scan in the hall with a box ahead that is not on its map."""
    box = ((5.0, 2.0), (6.0, 2.0), (6.0, 4.0), (5.0, 4.0))
    return seen(pose, PolygonMap(HALL.outer, (box,), unit="m"))


def test_a_localized_robot_on_a_right_map_has_nothing_against_it():
    found = rows((HERE, HERE, seen(HERE)))
    told = {name: found[name] for name in MAP_COLUMNS if name != "beyond_random"}
    against = ("off", "wrong", "short", "long", "repeated", "elsewhere")
    nothing = {name: [0.0] for name in against}
    assert told == nothing | {"explained": [1.0], "quality": [None]}
    assert 0 <= found["beyond_random"][0] <= 1


def test_what_is_not_on_the_map_is_wrong_at_the_true_pose_and_repeats_from_another_one():
    # the same cells are hit from both poses: the front of the box is 2 m wide, cells 0.3 m
    found = rows((HERE, HERE, with_box(HERE)), (THERE, THERE, with_box(THERE)))
    assert found["off"] == [0.0, 0.0]
    assert found["wrong"] == pytest.approx(found["short"])
    assert min(found["wrong"]) > WRONG
    assert found["long"] == [0.0, 0.0]
    first, second = zip(found["repeated"], found["elsewhere"], strict=True)
    assert first == (0.0, pytest.approx(found["short"][0]))
    assert second[0] > 0
    assert sum(second) == pytest.approx(found["short"][1])


def test_a_lost_robot_is_off_though_the_map_is_right():
    found = rows((FAR, HERE, seen(HERE)))
    assert found["off"] == [1.0]
    assert found["wrong"] == [0.0]
    assert found["explained"][0] < 0.5
    assert found["beyond_random"][0] < 0


def run(world, off, wrong, **signals):
    """A trial with these steps."""
    columns = dict.fromkeys(SIGNALS, [0.5] * len(off)) | {"off": off, "wrong": wrong} | signals
    padded = {name: values + [None] * (STEPS - len(values)) for name, values in columns.items()}
    return changed(finished("mcl", world, 1.0), against_map=padded)


def answers(records):
    """Rows of maps.csv by question and signal."""
    return maps_table(panels(records)).set_index(["question", "signal"])


def test_each_question_is_of_its_own_steps_and_a_signal_has_its_natural_order():
    off, wrong = [0.0, 0.0, 1.0, 1.0], [0.0, 0.5, 0.0, 0.5]
    records = [
        run(w, off, wrong, quality=[0.9, 0.8, 0.1, 0.2], short=[0.0, 0.4, 0.2, 0.3]) for w in (0, 1)
    ]
    told = answers(records)
    quality, short = (told.xs(name, level="signal") for name in ("quality", "short"))
    assert list(quality["auroc"]) == [1.0, 0.5, 1.0, 1.0]
    assert list(short["auroc"]) == [0.5, 1.0, 1.0, 0.0]
    assert list(quality["steps"]) == [0.5, 0.5, 0.5, 2 / 3]
    assert len(told) == len(QUESTIONS) * len(SIGNALS)


def test_a_question_that_no_step_is_about_has_no_answer_and_one_that_few_worlds_are_about_has():
    never = [run(w, [0.0, 0.0], [0.0, 0.0]) for w in (0, 1)]
    assert answers(never).loc["which", "auroc"].isna().all()
    once = [run(0, [1.0, 0.0], [0.5, 0.5], quality=[0.1, 0.9]), *never]
    assert answers(once).loc["lost", "quality"]["worlds"] == 1


def test_the_trust_in_a_plan_is_a_signal_of_those_who_doubt_it():
    plan = dict.fromkeys(PLAN_COLUMNS, [0.5] * STEPS)
    ours, theirs = ([run(w, [0.0, 1.0], [0.0, 0.0]) for w in (0, 1)] for _ in range(2))
    trusted = [0.9, 0.2] + [None] * (STEPS - 2)
    ours = [changed(one, plan=plan | {"trusted": trusted}) for one in ours]
    theirs = [changed(one, plan=plan | {"trusted": [None] * STEPS}) for one in theirs]
    assert answers(ours).loc["lost", "trusted"]["auroc"] == 1.0
    assert "trusted" not in answers(theirs).loc["lost"].index


def test_only_a_trial_whose_world_differs_from_the_map_keeps_signals():
    def record_of(**world):
        trial = Trial(
            scenario="sharp", localizer="dead-reckoning", params={}, lag=0, seed=0, trial=0,
            world=Overrides(world)
        )  # fmt: skip
        return record(Stage.of(trial).trace())

    assert record_of().against_map is None
    kept = record_of(**{"clutter.number": 3})
    assert kept.against_map.keys() == set(MAP_COLUMNS)
    assert {len(own) for own in kept.against_map.values()} == {kept.steps_done}
