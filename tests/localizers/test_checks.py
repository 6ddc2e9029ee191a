"""Every law can fail, each on an example that breaks nothing else; who is right passes all."""

import inspect
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from broken import LeavesAProcess, ProcessStateUntouched, TakesTheSecondForTheTurn
from following import small
from refusals import refused

import localizers
from deqmcl_gym.maps import GridMap
from deqmcl_gym.maps.map import scaled
from localizers import template
from localizers.checks import check_localizer, default_robot, law_name, report_of, subject
from localizers.checks import laws as laws_of
from localizers.checks import parametrize_with_laws as with_laws
from localizers.checks.subject import localizer_drive, process_state
from localizers.models.nav2_motion import DifferentialMotion
from localizers.template import MyLocalizer

BROKEN = Path(__file__).parent / "broken.py"
NAV2 = scaled(DifferentialMotion(), 50.0)  # in px
# all but that for which a process of a second or two is started
HERE = {law: need for law, need in laws_of.LAWS.items() if law is not laws_of.runs_in_a_worker}


def example(law):
    return f"{BROKEN}:{law_name(law).title().replace(' ', '')}"


@pytest.mark.parametrize("name", localizers.names())
def test_every_built_in_localizer_keeps_all_laws(name):
    verdicts = report_of(localizer_drive(name, **small(name, 500)), HERE).verdicts
    has_particles = "particles" in localizers.parameters(name)
    others = {verdict.law: verdict.status for verdict in verdicts if verdict.status != "ok"}
    assert others == ({} if has_particles else {"one particle": "skipped"})


@with_laws(MyLocalizer, particles=50)
def test_the_template_keeps(law):
    law()


WITHOUT_ONE = laws_of.answers_in_time, laws_of.increments_of_three
WITH_AN_EXAMPLE = [law for law in HERE if law not in WITHOUT_ONE]


@pytest.mark.parametrize("law", WITH_AN_EXAMPLE, ids=law_name)
def test_each_law_is_broken_by_its_example_which_keeps_all_others_and_the_process_as_it_was(law):
    before = process_state()
    (failed,) = report_of(localizer_drive(example(law)), HERE).failed
    assert failed.law == law_name(law)
    assert process_state() == before


def test_a_drive_that_takes_longer_than_the_limit_breaks_its_law():
    impatient = replace(localizer_drive("dead-reckoning"), time_limit=0.0)
    report = report_of(impatient, HERE)
    assert [verdict.law for verdict in report.failed] == ["answers in time"]
    assert "more than 0 s" in report.failed[0].note
    assert report.verdict("picklable").note == "it fails 'answers in time'"


@pytest.mark.parametrize("name", ["ekf", "grid"])
def test_estimators_in_closed_form_take_navs_motion_as_the_turn_and_drive_of_its_variances(name):
    robots = (replace(default_robot(), motion=one) for one in (NAV2, NAV2.turn_and_drive))
    runs = (localizer_drive(name, robot, **small(name, 0)).history() for robot in robots)
    assert subject.difference(*runs) is None


def test_a_plug_in_that_knows_increments_of_two_numbers_only_is_told_so():
    class Unpacks(MyLocalizer):
        def update(self, ranges, action, plan):
            distance, turn = action
            return super().update(ranges, np.array([distance, turn]), plan)

    for made, why in ((TakesTheSecondForTheTurn, "gives another belief"), (Unpacks, "ValueError")):
        verdict = check_localizer(made).verdict("increments of three")
        assert verdict.status == "skipped"
        assert verdict.note.startswith("not for logs, whose increments have three numbers: ")
        assert why in verdict.note


def test_a_localizer_that_works_only_here_breaks_the_law_of_the_worker_alone():
    (failed,) = check_localizer(example(laws_of.runs_in_a_worker)).failed
    assert failed.law == "runs in a worker"
    words = "in a spawned process: it raised OSError: no device in this process (broken.py, line"
    assert failed.note.startswith(words)


def robot_on_cells():
    """In a hall of 9 m by 7 m with a pillar, in cells of 0.1 m."""
    cells = np.zeros((70, 90), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[28:40, 28:60] = 100
    return subject.robot_on(GridMap(occupancy=cells, resolution=0.1))


@pytest.mark.parametrize("made", [default_robot, robot_on_cells])
@pytest.mark.parametrize("seed", range(3))
def test_the_random_drive_stays_in_free_space_and_its_scans_in_range(seed, made):
    robot = made()
    robot = replace(robot, lidar=replace(robot.lidar, max_range=robot.lidar.max_range * 3 / 8))
    drawn = subject.random_drive(robot, np.random.default_rng(seed))
    drive = replace(localizer_drive("dead-reckoning", robot), **drawn)
    belief, _ = next(drive.steps())
    poses = np.vstack([belief.points(t)[0] for t in range(len(drive.plans[0]) + 1)])
    collides = robot.floor_plan.collides(poses[:-1], poses[1:], robot.radius)
    assert not collides[drive.plans[0][:, 0] != 0].any()
    assert np.array_equal(drive.plans[0][: len(drive.actions)], drive.actions)
    assert drive.scans.shape == (len(drive.actions), 8)
    assert ((drive.scans >= 0) & (drive.scans <= robot.lidar.max_range)).all()


def test_what_the_constructor_raises_breaks_a_law_and_is_not_raised():
    failed = check_localizer("mcl", particles=-1).failed
    assert [verdict.law for verdict in failed] == ["makes a localizer"]
    assert "particles is -1" in failed[0].note


def test_a_factory_without_a_name_cannot_run_in_a_worker_and_is_told_how_to():
    (verdict,) = check_localizer(lambda robot: MyLocalizer(robot, particles=20)).failed
    assert verdict.law == "runs in a worker"
    assert verdict.note.endswith("as package.module:NAME or path/to/file.py:NAME")


@localizers.registered("mine", MyLocalizer)
def test_a_registered_factory_is_sent_as_it_is():
    assert check_localizer("mine", particles=20).passed


@pytest.mark.parametrize("change", ProcessStateUntouched.CHANGES)
def test_a_changed_state_of_the_process_is_named_and_put_back(change):
    before, report = process_state(), check_localizer(ProcessStateUntouched, change=change)
    failed = report.verdict("process state untouched")
    assert failed.status == "FAILED"
    assert f"it changes {change} for its whole process" in failed.note
    assert process_state() == before


def test_a_process_that_is_left_running_is_named():
    with pytest.raises(subject.LawBrokenError, match=r"it leaves the process \d+.* running"):
        laws_of.nothing_left_running(localizer_drive(LeavesAProcess))


def test_a_deterministic_localizer_that_needs_a_mean_is_told_so_and_passes():
    report = check_localizer("dead-reckoning")
    assert report.verdict("other rng other result").note == "deterministic, it draws nothing"
    assert report.verdict("prior without mean").note == "refused"


@pytest.mark.parametrize(
    ("line", "broken"),
    [
        ("import numpy; numpy.seterr(all='raise')", "np.seterr"),
        ("import sys; sys.setrecursionlimit(5_000)", "the recursion limit"),
        ("import os, warnings; os.environ['MINE'] = ''; warnings.simplefilter('ignore')", None),
    ],
)
def test_what_an_import_changes_of_the_process_is_seen(tmp_path, line, broken):
    (tmp_path / "mine.py").write_text(f"{line}\n{inspect.getsource(template)}")
    with subject.state_kept():
        report = check_localizer(f"{tmp_path}/mine.py:MyLocalizer")
        verdict = report.verdict("process state untouched")
    assert verdict.status == ("FAILED" if broken else "ok")
    assert broken is None or f"its import changes {broken} for" in verdict.note


SUITE = f"""
from localizers.checks import parametrize_with_laws
from localizers.template import MyLocalizer

MINE = {example(laws_of.weights_sum_to_one)!r}

@parametrize_with_laws(MINE, expected_failures={{"weights sum to one": "likelihoods, by design"}})
def test_declared(law):
    law()

@parametrize_with_laws(MINE)
def test_undeclared(law):
    law()

@parametrize_with_laws(MyLocalizer, expected_failures={{"finite": "?"}})
def test_mended(law):
    law()
"""


def test_expected_failures_are_strict_xfails(pytester):
    pytester.makepyfile(test_mine=SUITE)
    chosen = "mended and finite or weights and not mended"
    done = pytester.runpytest_inprocess("-rfx", "-k", chosen, "-p", "no:cacheprovider")
    assert [line.split(" - ")[0] for line in done.outlines if line[:5] in ("FAILE", "XFAIL")] == [
        "FAILED test_mine.py::test_undeclared[weights sum to one]",
        "FAILED test_mine.py::test_mended[finite]",
        "XFAIL test_mine.py::test_declared[weights sum to one]",
    ]


def test_an_expected_failure_of_no_law_is_refused():
    with refused("did you mean 'finite'"):
        with_laws("mcl", expected_failures={"finit": "?"})
