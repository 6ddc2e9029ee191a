"""The built-in suites, and what a sweep makes of its settings."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.sweeps.running import check
from benchmarks.sweeps.suites import FAMILIES, PAPER_METHODS, SUITES, with_localizers
from benchmarks.sweeps.sweepfile import sweeps_named
from benchmarks.trials.episode import room_of, trial_moments
from benchmarks.trials.presets import ASSUMED
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import InputError
from localizers import names


def trial(**changes):
    base = {
        "scenario": "sharp",
        "localizer": "dead-reckoning",
        "params": (),
        "lag": 0,
        "seed": 0,
        "trial": 0,
    }
    return Trial(**base | changes)


@pytest.mark.parametrize("name", SUITES)
def test_every_built_in_suite_can_be_made(name):
    check(SUITES[name])


def test_the_suites_are_those_promised():
    assert list(SUITES) == [
        *("quick", "paper", "headline"),
        *("particles", "lag", "beta", "sensor", "noise", "disturbed"),
        *("lookahead", "guided", "matched", "sharp"),
        *("study-sensor", "study-noise", "study-assumed", "study-particles"),
        *("study-lag", "study-beta", "study-plan", "study-pilots"),
    ]
    assert not set(FAMILIES) & set(SUITES)


def test_the_headline_is_200_paired_worlds_with_three_runs_each_of_all_presets():
    trials = SUITES["headline"].distinct()
    assert len(trials) == 3 * 6 * 200 * 3
    assert {t.scenario for t in trials} == {"paper", "matched", "sharp"}
    worlds = {}
    for t in trials:
        worlds.setdefault((t.scenario, t.localizer), []).append((t.trial, t.filter_seed))
    assert {t.localizer for t in trials} == set(PAPER_METHODS)
    assert len({tuple(own) for own in worlds.values()}) == 1


LOOKAHEAD = {  # scenario, runs on each world, whether it has the classical methods and the limit
    "lookahead": ("paper", 3, False, True),
    "guided": ("guided", 1, True, True),
    "matched": ("matched", 1, True, False),
    "sharp": ("sharp", 1, False, False),
}


@pytest.mark.parametrize("name", LOOKAHEAD)
def test_every_way_to_look_ahead_runs_on_200_paired_worlds_at_both_numbers_of_particles(name):
    scenario, seeds, classical, limited = LOOKAHEAD[name]
    sweep, runs = SUITES[name], {}
    for t in {json.dumps(t.canonical()): t for t in sweep.compared()}.values():
        runs.setdefault((t.localizer, t.params), []).append((t.trial, t.filter_seed))
    assert {t.scenario for t in sweep.listed()} == {scenario}
    assert all(own == [(w, s) for w in range(200) for s in range(seeds)] for own in runs.values())
    filters = {*PAPER_METHODS, "deq-mcl-rejuvenated", "mcl-h", "mcl-pilots"}
    others = {"grid", "amcl", "ekf"} if classical else set()
    assert {method for method, _ in runs} == filters | others
    for method in filters - {"dead-reckoning"}:
        particles = [dict(p)["particles"] for other, p in runs if other == method]
        twice = method == "mcl-h" and name != "guided"
        assert particles == ([300, 300, 1000, 1000] if twice else [300, 1000])
    forms = {None} if name == "guided" else {None, "twisted"}
    assert {dict(p).get("form") for method, p in runs if method == "mcl-h"} == forms
    limits = {(t.localizer, dict(t.params)["particles"]) for t in sweep.limits()}
    assert limits == ({("mcl-pilots", 100_000)} if limited else set())
    worlds = {t.trial for t in sweep.limits()}
    assert worlds == (set(range(20)) if limited else set())


def test_the_study_is_its_suites_around_the_same_two_centres():
    assert FAMILIES["study"] == tuple(name for name in SUITES if name.startswith("study-"))
    centres = set()
    for name in FAMILIES["study"]:
        sweep = SUITES[name]
        assert (sweep.baseline, sweep.trials, sweep.filter_seeds) == ("mcl-map", 25, 2)
        presets = {t.scenario for t in sweep.cells()}
        only = {"study-plan": {"matched"}, "study-pilots": {"guided"}}
        assert presets == only.get(name, {"matched", "guided"})
        assert 300 in {dict(t.params).get("particles") for t in sweep.cells()}
        assert 20 in {t.lag for t in sweep.cells()}
        centres |= {t.scenario for t in sweep.cells() if not (t.world or t.disturbance)}
    assert centres == {"matched", "guided"}


def test_the_documents_name_every_suite_of_the_study():
    text = (Path(__file__).parents[2] / "docs" / "study.md").read_text(encoding="utf-8")
    assert [name for name in FAMILIES["study"] if f"`{name}`" not in text] == []


def test_a_family_is_its_suites_in_folders_of_their_names_and_a_suite_is_itself():
    assert list(sweeps_named("study")) == list(FAMILIES["study"])
    assert sweeps_named("quick") == {"": SUITES["quick"]}
    added = sweeps_named("study", ["ekf"])
    assert all("ekf" in {m.name for m in sweep.localizers} for sweep in added.values())


def test_a_localizer_added_to_a_suite_runs_on_its_worlds_and_one_it_has_is_not_added():
    quick = SUITES["quick"]
    assert with_localizers(quick, ["mcl"]) == quick
    lag = with_localizers(SUITES["lag"], ["mcl", "mcl"])
    assert [method.name for method in lag.localizers].count("mcl") == 1
    assert {t.lag for t in lag.distinct() if t.localizer == "mcl"} == {0, 5, 10, 20, 40}


def test_a_change_of_the_world_reaches_the_world_and_leaves_the_other_streams_alone():
    room = room_of("paper", (("lidar.beams", 9), ("lidar.sigma", 1.0), ("noise.drive", 0.5)))
    assert (room.lidar.beams, room.lidar.sigma, room.world.noise.drive) == (9, 1.0, 0.5)
    assert room.world.noise.turn == room_of("paper").world.noise.turn
    ours = [m.truth for m in trial_moments(trial())]
    theirs = [m.truth for m in trial_moments(trial(world=(("lidar.sigma", 50.0),)))]
    assert np.array_equal(ours, theirs)  # another sensor, the same motion


def test_an_assumption_reaches_the_filters_and_no_other_is_changed():
    assumed = ASSUMED["sharp"]
    changed = assumed.changed({"scan.sigma": 7.0, "motion.drive": 0.3, "start_sd_heading": 0.5})
    assert (changed.scan.sigma, changed.motion.drive, changed.start_sd_heading) == (7.0, 0.3, 0.5)
    assert type(changed.scan) is type(assumed.scan)
    assert changed.motion.turn == assumed.motion.turn
    assert assumed.scan.sigma == 5.0


def test_an_assumption_changes_the_filter_and_not_the_world():
    sharp = trial(localizer="mcl", params=(("particles", 20),))
    ours, theirs = (
        list(trial_moments(t)) for t in (sharp, trial(**vars(sharp) | {"assumed": SIGMA}))
    )
    assert np.array_equal([m.ranges for m in ours], [m.ranges for m in theirs])
    assert not np.array_equal(ours[-1].belief.points()[0], theirs[-1].belief.points()[0])


SIGMA = (("scan.sigma", 50.0),)


def test_a_kidnapped_robot_is_elsewhere_from_its_step_on():
    kidnap = ((("kind", "kidnap"), ("step", 100)),)
    ours = [m.truth for m in trial_moments(trial())]
    theirs = [m.truth for m in trial_moments(trial(disturbance=kidnap))]
    assert np.array_equal(ours[:100], theirs[:100])
    assert not np.array_equal(ours[100], theirs[100])


def test_lost_beams_read_infinity_and_do_not_move_the_robot():
    dropout = ((("kind", "dropout"), ("probability", 0.5)),)
    ours, theirs = list(trial_moments(trial())), list(trial_moments(trial(disturbance=dropout)))
    assert np.array_equal([m.truth for m in ours], [m.truth for m in theirs])
    lost = np.isinf([m.ranges for m in theirs])
    assert 0.4 < lost.mean() < 0.6  # 205 x 9 beams: 0.5 within 8 standard deviations


def test_the_disturbed_suite_runs_every_localizer():
    assert {method.name for method in SUITES["disturbed"].localizers} == set(names())


def test_the_plan_of_the_disturbed_suite_leads_back_to_the_start():
    change = SUITES["disturbed"].vary[0].values["disturbance"][3]
    still = (("noise.drive", 0.0), ("noise.turn", 0.0), ("noise.drift", 0.0))
    truths = [m.truth for m in trial_moments(trial(world=still, disturbance=change))]
    assert len(truths) == 1 + 100 + 12 + 23 + 6 + 40 + 6 + 25
    assert np.allclose(truths[-1][:2], truths[0][:2], atol=1e-3)  # float32 actions


def test_disturbances_are_stacked():
    both = ((("kind", "kidnap"), ("step", 5)), (("kind", "dropout"), ("probability", 1.0)))
    moments = list(trial_moments(trial(disturbance=both)))
    assert np.isinf([m.ranges for m in moments]).all()
    assert np.hypot(*(moments[5].truth - moments[4].truth)[:2]) > 20  # no step is so long


BAD = [
    ({"world": (("lidr.beams", 9),)}, ["'lidr'", "did you mean 'lidar'?"]),
    ({"world": (("lidar.beans", 9),)}, ["'beans'", "did you mean 'beams'?"]),
    ({"world": (("lidar.beams", 0),)}, ["lidar.beams", "0"]),
    ({"world": (("lidar", 9),)}, ["world.lidar"]),
    ({"world": (("ends_at_goal", True),)}, ["'ends_at_goal'"]),
    ({"assumed": (("scan.sigm", 9),)}, ["'scan.sigm'", "did you mean 'scan.sigma'?"]),
    ({"assumed": (("scan.sigma", 0),)}, ["scan.sigma", "0"]),
    ({"assumed": (("scan", 9),)}, ["'scan'", "scan.sigma"]),
    ({"assumed": (("start_sd_position", -1),)}, ["start_sd_position", "-1"]),
    ({"disturbance": ((("step", 3),),)}, ["no kind", "kidnap"]),
    ({"disturbance": ((("kind", "kidnapp"),),)}, ["did you mean 'kidnap'?"]),
    ({"disturbance": ((("kind", "kidnap"),),)}, ["'kidnap'", "step"]),
    ({"disturbance": ((("kind", "kidnap"), ("step", 0)),)}, ["step", "0"]),
    ({"disturbance": ((("kind", "kidnap"), ("stop", 3)),)}, ["did you mean 'step'?"]),
    ({"disturbance": ((("kind", "dropout"), ("probability", 2)),)}, ["probability", "2"]),
]


@pytest.mark.parametrize(("changes", "named"), BAD)
def test_a_setting_that_cannot_be_is_refused(changes, named):
    with pytest.raises(InputError) as caught:
        list(trial_moments(trial(**changes)))
    for words in named:
        assert words in str(caught.value)
