"""Every law can fail, each on an example that breaks nothing else; who is right passes all."""

import inspect
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from broken import LeavesAProcess, ProcessStateUntouched, TakesTheSecondForTheTurn

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.maps.map import scaled
from deqmcl_gym.validation import InputError
from localizers import template
from localizers.checks import LAWS, LawBrokenError, check_localizer, parametrize_with_laws
from localizers.checks.answers import increments_of_three
from localizers.checks.laws import Here, subject_of
from localizers.checks.lifecycle import set_state, state_of_process
from localizers.checks.run import Examination
from localizers.checks.subject import default_robot, first_difference, random_drive, robot_on_cells
from localizers.methods.dead_reckoning import dead_reckoning
from localizers.models.nav2_motion import DifferentialMotion
from localizers.template import MyLocalizer

BROKEN = Path(__file__).parent / "broken.py"
NAV2 = scaled(DifferentialMotion(), 50.0)  # in px
IN_A_PROCESS = ("answers in time", "runs in a worker")
BY_NAME = {law.name: law for law in LAWS}


@pytest.fixture(autouse=True)
def _state_put_back():
    held = state_of_process()
    yield
    set_state(held)


def example(law):
    return f"{BROKEN}:{law.title().replace(' ', '')}"


def verdicts_here(subject):
    """Of all laws but those for which a process of a second or two is started."""
    alone = replace(subject, sent=lambda: None)  # cannot be sent
    examination = Examination(Here(alone))
    return [v for v in map(examination.verdict, LAWS) if v.law not in IN_A_PROCESS]


def broken_here(subject):
    return [verdict.law for verdict in verdicts_here(subject) if verdict.status == "FAILED"]


def coarse(name):
    """Parameters without which a localizer is slow."""
    if name == "cbgl":
        return {"poses": 1000}
    return {"cell": 20.0, "headings": 36} if name == "grid" else {}


@pytest.mark.parametrize("name", localizers.names())
def test_every_built_in_localizer_keeps_all_laws(name):
    verdicts = verdicts_here(subject_of(name, **coarse(name)))
    has_particles = "particles" in localizers.parameters(name)
    others = {verdict.law: verdict.status for verdict in verdicts if verdict.status != "ok"}
    assert others == ({} if has_particles else {"one particle": "skipped"})


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.slow] * (n != "deq-mcl")) for n in localizers.names()],
)
def test_every_built_in_localizer_keeps_the_laws_of_a_process_too(name):
    examination = Examination(Here(subject_of(name, **coarse(name))))
    verdicts = [examination.verdict(BY_NAME[law]) for law in IN_A_PROCESS]
    assert [verdict.status for verdict in verdicts] == ["ok", "ok"], [*map(str, verdicts)]


@parametrize_with_laws(MyLocalizer, particles=50)
def test_the_template_keeps(law):
    law()


@pytest.mark.parametrize("law", [name for name in BY_NAME if name not in IN_A_PROCESS])
def test_each_law_is_broken_by_its_example_which_keeps_all_others(law):
    assert broken_here(subject_of(example(law))) == [law]


@pytest.mark.parametrize("name", localizers.names())
def test_every_built_in_localizer_takes_increments_with_navs_motion_model_too(name):
    subject = subject_of(name, replace(default_robot(), motion=NAV2), **coarse(name))
    assert increments_of_three(subject) is None


@pytest.mark.parametrize("name", ["ekf", "grid"])
def test_estimators_in_closed_form_take_navs_motion_as_the_turn_and_drive_of_its_variances(name):
    own, stated = (
        subject_of(name, replace(default_robot(), motion=one), **coarse(name)).history()
        for one in (NAV2, NAV2.turn_and_drive)
    )
    assert first_difference(own, stated) is None


def test_a_plug_in_that_knows_increments_of_two_numbers_only_gets_a_remark():
    def unpacks(robot):
        localizer = MyLocalizer(robot)
        update = localizer.update

        def with_two(ranges, action, plan):
            distance, turn = action
            return update(ranges, (distance, turn), plan)

        localizer.update = with_two
        return localizer

    for own, why in ((TakesTheSecondForTheTurn, "gives another belief"), (unpacks, "ValueError")):
        verdict = Here(subject_of(own)).verdict(BY_NAME["increments of three"])
        assert verdict.status == "ok"
        assert verdict.note.startswith("not for logs, whose increments have three numbers: ")
        assert why in verdict.note


def test_a_localizer_that_works_only_here_breaks_the_law_of_the_worker_alone():
    report = check_localizer(example("runs in a worker"))
    (failed,) = map(str, report.failed)
    assert failed.startswith(
        "FAILED   runs in a worker: in a spawned process: it raised OSError: no device in this "
        "process (broken.py, line"
    )


def test_a_localizer_that_hangs_is_given_up_and_nothing_else_is_tried():
    first, *others = check_localizer(example("answers in time"), timeout=1.0).verdicts
    assert (first.status, first.note) == ("FAILED", "a separate process gave no answer within 1 s")
    assert {verdict.note for verdict in others} == {"it fails 'answers in time'"}


def test_a_localizer_that_ends_the_process_ends_only_its_own():
    first = check_localizer(f"{BROKEN}:EndsTheProcess").verdicts[0]
    assert first.status == "FAILED"
    assert first.note == "a separate process ended without an answer, with exit code 7"


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("beams", [1, 8])
@pytest.mark.parametrize("name", ["deq-mcl", "localizers.template:MyLocalizer"])
def test_the_laws_are_kept_on_any_drive_and_lidar(name, beams, seed):
    robot = replace(default_robot(), lidar=Lidar(beams=beams))
    subject = subject_of(name, robot, particles=50)
    drive = random_drive(robot, np.random.default_rng(seed))
    assert broken_here(replace(subject, drive=drive)) == []


@pytest.mark.parametrize("seed", range(10))
def test_a_mean_of_headings_that_is_none_of_directions_is_found_on_any_drive(seed):
    subject = subject_of(example("half turn"))
    drive = random_drive(subject.robot, np.random.default_rng(seed))
    with pytest.raises(LawBrokenError):
        BY_NAME["half turn"](replace(subject, drive=drive))


@pytest.mark.parametrize("made", [default_robot, robot_on_cells])
@pytest.mark.parametrize("seed", range(10))
def test_the_random_drive_stays_in_free_space_and_its_scans_in_range(seed, made):
    robot = made()
    robot = replace(robot, lidar=replace(robot.lidar, max_range=robot.lidar.max_range * 3 / 8))
    drive = random_drive(robot, np.random.default_rng(seed))
    commands = dead_reckoning(robot)
    belief = commands.reset(drive.prior, drive.plans[0], np.random.default_rng(0))
    poses = np.vstack([belief.points(t)[0] for t in range(len(drive.plans[0]) + 1)])
    collides = robot.floor_plan.collides(poses[:-1], poses[1:], robot.radius)
    assert not collides[drive.plans[0][:, 0] != 0].any()
    assert np.array_equal(drive.plans[0][: len(drive.actions)], drive.actions)
    assert drive.scans.shape == (len(drive.actions), 8)
    assert ((drive.scans >= 0) & (drive.scans <= robot.lidar.max_range)).all()


NARROW = PolygonMap(outer=[(0, 0), (10, 0), (10, 300), (0, 300)])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"localizer": "dec-mcl"}, "did you mean 'deq-mcl'"),
        ({"localizer": "mcl", "particels": 3}, "did you mean 'particles'"),
        ({"localizer": "mcl", "timeout": 0}, "the timeout is 0"),
        ({"localizer": "mcl", "robot": replace(default_robot(), floor_plan=NARROW)}, "is 8 px"),
    ],
)
def test_a_bad_question_is_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        check_localizer(**arguments)


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


def test_the_law_of_the_global_random_states_leaves_them_as_they_were():
    law = BY_NAME["global rng untouched"]
    before = np.random.get_state(legacy=False)["state"], random.getstate()  # noqa: NPY002
    with pytest.raises(LawBrokenError):
        law(subject_of(example(law.name)))
    after = np.random.get_state(legacy=False)["state"], random.getstate()  # noqa: NPY002
    assert np.array_equal(before[0]["key"], after[0]["key"])
    assert (before[0]["pos"], before[1]) == (after[0]["pos"], after[1])


@pytest.mark.parametrize("change", ProcessStateUntouched.CHANGES)
def test_a_changed_state_of_the_process_is_named_and_put_back(change):
    before = state_of_process()
    for _ in range(2):  # also if it was changed before
        with pytest.raises(LawBrokenError, match=f"it changes {change} for its whole process"):
            BY_NAME["process state untouched"](subject_of(ProcessStateUntouched, change=change))
    assert state_of_process() == before


@pytest.mark.parametrize(
    ("line", "broken"),
    [
        ("import numpy; numpy.seterr(all='raise')", "np.seterr"),
        ("import sys; sys.setrecursionlimit(5_000)", "the recursion limit"),
        ("import os, warnings; os.environ['MINE'] = ''; warnings.simplefilter('ignore')", None),
    ],
)
def test_what_an_import_changes_of_the_process_is_seen_but_for_what_many_add(
    tmp_path, line, broken
):
    (tmp_path / "mine.py").write_text(f"{line}\n{inspect.getsource(template)}")
    failed = check_localizer(f"{tmp_path}/mine.py:MyLocalizer").failed
    assert [one.law for one in failed] == ["process state untouched"] * bool(broken)
    assert broken is None or f"its import changes {broken} for" in failed[0].note


def test_a_localizer_from_a_file_changes_nothing_here_while_it_is_checked():
    before = state_of_process()
    subject = example("process state untouched")
    (failed,) = check_localizer(subject, change="the working folder").failed
    assert failed.law == "process state untouched"
    assert state_of_process() == before


def test_a_process_that_is_left_running_is_named():
    with pytest.raises(LawBrokenError, match=r"it leaves the process \d+.* running"):
        BY_NAME["nothing left running"](subject_of(LeavesAProcess))


def test_a_deterministic_localizer_that_needs_a_mean_is_told_so_and_passes():
    notes = {verdict.law: verdict.note for verdict in verdicts_here(subject_of("dead-reckoning"))}
    assert notes["other rng other result"] == "deterministic, it draws nothing"
    assert notes["prior without mean"] == "refused"


SUITE = f"""
from localizers.checks import parametrize_with_laws
from localizers.template import MyLocalizer

MINE = {example("weights sum to one")!r}

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
    with pytest.raises(InputError, match="did you mean 'finite'"):
        parametrize_with_laws("mcl", expected_failures={"finit": "?"})
