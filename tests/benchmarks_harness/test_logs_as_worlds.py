"""A segment of a log is a world, a replayed lap is that lap, its noise is that which made it."""

import math
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from deqmcl_command import exit_code, lines
from drives import recorded_in_a_hall, write_lap
from refusals import refused

import deqmcl_gym  # noqa: F401  # registers the envs
from benchmarks.setup.logs import motion_noise, typical_steps
from benchmarks.setup.names import make_agent, scenario, scenario_digest
from benchmarks.sweeps.sweepfile import read_sweep
from benchmarks.trials import Trial
from benchmarks.trials.episode import moments
from benchmarks.trials.stage import Stage, key_of
from deqmcl_gym.envs.log import LogEnv
from deqmcl_gym.logs import Log, Scanner, Trajectory
from deqmcl_gym.logs.motion import dead_reckoned, increments_of
from deqmcl_gym.logs.trajectory import referenced
from deqmcl_gym.validation import InputError
from localizers import OdometryMotion, make
from localizers.models import nav2_motion
from localizers.models.nav2_motion import DifferentialMotion, OmniMotion, kind_of, unknown_motion

WORLD = """
log = "data/lap.csv"
map = "data/hall.yaml"
reference = "data/lap.tum"
segment = 3.0
every = "0.05m,3deg"
max_beams = 15
"""
SCENARIO = f"""
base = "log"
[env]
{WORLD}
"""
SWEEP = f"""
scenario = "log"
trials = 3
localizers = ["mcl", "dead-reckoning"]
[world]
{WORLD}
[params]
particles = 100
"""
NOISY = [  # above what is assumed anyway
    OdometryMotion(drive=0.3, turn=0.4, drift=0.25),
    DifferentialMotion(alpha1=0.5, alpha2=0.4, alpha3=0.3, alpha4=0.3),
    OmniMotion(alpha1=0.5, alpha2=0.4, alpha3=0.3, alpha4=0.3, alpha5=0.4),
]
STEPS = 4000
# as of good odometry
QUIET = [
    DifferentialMotion(alpha1=0.02, alpha2=0.01, alpha3=0.01, alpha4=0.002),
    OmniMotion(alpha1=0.02, alpha2=0.01, alpha3=0.01, alpha4=0.002, alpha5=0.01),
]


@pytest.fixture(scope="module")
def drive():
    return recorded_in_a_hall(steps=60)


@pytest.fixture
def folder(drive, here):
    """A folder with sweep and scenario, their data below it; nobody stands in it."""
    home = here / "home"
    (home / "data").mkdir(parents=True)
    write_lap(drive, home / "data")
    (home / "hall.toml").write_text(SCENARIO)
    (home / "sweep.toml").write_text(SWEEP)
    return home


def trials(folder, text=SWEEP):
    (folder / "sweep.toml").write_text(text)
    return read_sweep(folder / "sweep.toml").distinct()


def test_methods_see_the_same_segment_and_worlds_begin_anywhere(folder):
    seen = [list(Stage.of(trial).moments()) for trial in trials(folder)]
    mcl, other = seen[:3], seen[3:]
    for ours, theirs in zip(mcl, other, strict=True):
        for one, two in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(one.ranges, two.ranges)
            np.testing.assert_array_equal(one.truth, two.truth)
            np.testing.assert_array_equal(one.action, two.action)
    assert len({tuple(moments[0].truth) for moments in mcl}) == 3


def test_the_prior_is_around_the_reference_where_the_segment_begins(folder):
    for trial in trials(folder)[:2]:
        start = next(iter(Stage.of(trial).moments()))
        poses, _ = start.belief.points()
        assert np.hypot(*(poses.mean(axis=0) - start.truth)[:2]) < 5 * 0.2 / math.sqrt(100)
    ours = scenario(str(folder / "hall.toml"))
    room = ours.room()
    room.reset(seed=4)
    assert ours.prior_in(room).mean == room.record.reference
    anywhere = ours.changed(assumed={"prior.kind": "uniform"}).prior_in(room)
    assert anywhere.mean is None


@pytest.mark.parametrize("kind", [None, "odometry", "omni"])
def test_the_noise_is_that_of_the_log_unless_it_is_given(folder, kind):
    chosen = {} if kind is None else {"motion.kind": kind}
    name, value = ("drive", 0.5) if kind == "odometry" else ("alpha3", 0.5)
    assumed = unknown_motion(kind or "differential", "m")
    ours = scenario(str(folder / "hall.toml"))
    room = ours.room()
    found = ours.changed(assumed=chosen).robot_model(room).motion
    assert found == motion_noise(room.log, kind or "differential")
    told = ours.changed(assumed=chosen | {f"motion.{name}": value})
    assert told.robot_model(room).motion == replace(assumed, **{name: value})


@pytest.mark.parametrize("power", [1.0, 0.05])
def test_on_a_log_beta_is_tempered_as_scans_are_and_in_rooms_and_offices_it_is_not(folder, power):
    for name, factor in ((str(folder / "hall.toml"), power), ("paper", 1.0), ("lost", 1.0)):
        ours = scenario(name).changed(assumed={"scan.power": power}).in_building(0)
        assert ours.robot_model(ours.room()).beta == 10.0 * factor


def test_a_result_is_named_by_what_is_in_the_files_of_its_world(folder):
    keys = [key_of(trials(folder)[0])]
    digests = [scenario_digest(str(folder / "hall.toml"))]
    for name in ("lap.csv", "lap.tum", "hall.pgm", "hall.yaml"):
        file = folder / "data" / name
        file.write_bytes(file.read_bytes() + b"\n")
        keys.append(key_of(trials(folder)[0]))
        digests.append(scenario_digest(str(folder / "hall.toml")))
    assert len(set(keys)) == len(set(digests)) == 5


def test_a_sweep_goes_over_a_log_and_says_what_is_damaged(folder, capsys):
    torn = folder / "data" / "lap.csv"
    torn.write_text(torn.read_text() + "1,2,3\n")
    out = folder / "out"
    assert exit_code("sweep", folder / "sweep.toml", "--out", out, "--jobs", "1") == 0
    said = capsys.readouterr().err
    assert said.count("skipped 1 of 62 records: 1 unreadable") == 1
    rows = [row for row in lines(out) if row["offset"] == "0"]
    assert len(rows) == 6
    assert all(float(row["position_rmse"]) < 0.5 for row in rows if row["method"] == "mcl")


KIDNAP = 'kind = "kidnap"\nstep = 3'
BAD = [
    ("log = ", "", "names no log"),
    ("reference = ", "", "no reference to score by"),
    ("segment = 3.0", "segment = 900.0", "no stretch as long as that"),
    ("segment", "sigment", "did you mean 'segment'?"),
    ("[params]", f"[[disturbance]]\n{KIDNAP}\n[params]", "needs deqmcl_gym/Room-v0"),
]


@pytest.mark.parametrize(("old", "new", "named"), BAD)
def test_a_bad_world_is_refused_before_anything_is_written(folder, refusal, old, new, named):
    kept = [line for line in SWEEP.splitlines() if new or not line.startswith(old)]
    text = "\n".join(kept).replace(old, new)
    (folder / "sweep.toml").write_text(text)
    refusal(["sweep", folder / "sweep.toml", "--out", folder / "out"], named)
    assert not (folder / "out").exists()


def test_an_agent_that_would_drive_a_log_is_refused(folder):
    changed = SCENARIO.replace("[env]", 'agent = "on-estimate"\n[env]\nplan = "none"')
    (folder / "hall.toml").write_text(changed)
    with refused("recorded actions"):
        scenario(str(folder / "hall.toml")).room()


def told(steps: int = STEPS, seed: int = 0) -> np.ndarray:
    """Increments of 0.1 to 0.4 m, some 0.2 rad each."""
    rng = np.random.default_rng(seed)
    ways, turns = rng.uniform(0.1, 0.4, steps), rng.normal(0, 0.2, steps)
    return np.column_stack([ways, np.zeros(steps), turns])


@cache
def done_by(model) -> np.ndarray:
    rng, begin = np.random.default_rng(1), np.zeros((3, 1), np.float32)
    ends = np.array([model.sample(begin, one, rng)[:, 0] for one in told()], dtype=float)
    return np.array([increments_of(np.vstack([np.zeros(3), end]))[0] for end in ends])


def log_of(meant: np.ndarray, done: np.ndarray, every: int = 1, unit: str = "m") -> Log:
    """A log whose reference has the pose of every so many-th record."""
    times = np.arange(len(meant) + 1.0)
    scanner = Scanner(angles=(0.0,), max_range=5.0)
    ranges = np.ones((times.size, 1))
    log = Log(scanner, times, dead_reckoned(meant), ranges, unit=unit)
    truth = Trajectory(times[::every], dead_reckoned(done)[::every])
    return referenced(log, truth, max_gap=math.inf)


@pytest.mark.parametrize("model", NOISY, ids=kind_of)
def test_noise_above_what_is_assumed_is_found_again_by_a_model_of_its_kind(model):
    # Half of the 4,000 steps tell the noise of drives: √(2 / 2,000) = 3 %, the 99 % point 6 % of a
    # variance. Noise from turning and from driving trades off, by some times that: 25 %; α4 is
    # a fifth of its variance at most: 60 %.
    found = motion_noise(log_of(told(), done_by(model)), kind_of(model))
    for name, value in vars(model).items():
        assert getattr(found, name) == pytest.approx(value, rel=0.6 if name == "alpha4" else 0.25)


@pytest.mark.parametrize("unit", ["m", "px"])
@pytest.mark.parametrize("kind", nav2_motion.MOTION_MODELS)
def test_noise_is_never_less_than_half_of_what_is_assumed_of_an_unknown_robot(kind, unit):
    meant = told(200)
    perfect = log_of(meant * ([50, 50, 1] if unit == "px" else 1), meant, unit=unit)
    perfect = log_of(perfect.increments, perfect.increments, unit=unit)
    model = unknown_motion(kind, unit)
    half = {name: value / 2 for name, value in vars(model).items() if name != "still"}
    assert motion_noise(perfect, kind) == replace(model, **half)


@pytest.mark.parametrize("every", [2, 10])
@pytest.mark.parametrize("model", QUIET, ids=kind_of)
def test_a_sparse_reference_tells_the_noise_of_a_step_as_a_dense_one_does(model, every):
    meant = told()
    logs = (log_of(meant, done_by(model), each) for each in (1, every))
    dense, sparse = (type(model).fitted(*typical_steps(log)) for log in logs)
    # a variance of k errors is right to √(2 / k), the 99 % point that drives are raised to to
    # 0.0995 / (0.029 √k), 1.33 / √k of its 2.58, and twice that of the variance
    stretches = STEPS // every
    of_turns, of_drives = 5 * math.sqrt(2 / stretches), 5 * 2 * 1.33 / math.sqrt(stretches / 2)
    ways, turns = np.mean(meant[:, 0] ** 2), np.mean(meant[:, 2] ** 2)

    def variances(found) -> tuple[float, float]:  # of an average step's way and turn
        return found.alpha3 * ways + found.alpha4 * turns, found.alpha1 * turns + 2 * (
            found.alpha2 * ways
        ) / (1 if isinstance(found, DifferentialMotion) else 2)

    (drive, turn), (own_drive, own_turn) = variances(sparse), variances(dense)
    assert abs(math.log(turn / own_turn)) < math.log1p(of_turns), (turn, own_turn)
    assert abs(math.log(drive / own_drive)) < math.log1p(of_drives), (drive, own_drive)


@pytest.mark.parametrize("every", [1, 4, 20])
def test_a_wheel_that_is_too_small_is_an_error_of_each_step_however_sparse_the_reference(every):
    # 5 % of each way and turn. Were it noise, it would grow as √n in a stretch: 0.22 for 20.
    meant = np.tile([0.25, 0.0, 0.02], (STEPS, 1))
    steps, true = typical_steps(log_of(meant, meant * 1.05, every))
    # a stretch is a chord of an arc of θ ≤ 0.4 rad, shorter by θ² / 24, of which the difference
    # (1.05³ - 1) θ² / 24 = 0.001
    assert (true - steps)[:, 0] / steps[:, 0] == pytest.approx(0.05, abs=0.002)
    assert (true - steps)[:, 2] / steps[:, 2] == pytest.approx(0.05, abs=0.002)


def test_what_cannot_be_estimated_from_is_refused_with_what_to_give_instead():
    meant = told(20)
    log = log_of(meant, meant)
    with pytest.raises(InputError, match="no reference: give the noise of the motion instead"):
        motion_noise(Log(log.scanner, log.times, log.odometry, log.ranges))
    with pytest.raises(InputError, match=r"has 9 stretches .* needs 10: give assumed.motion"):
        motion_noise(log.segment(0, 10))
    with pytest.raises(InputError, match="has 4 stretches"):
        motion_noise(log_of(meant, meant, every=5))


@pytest.mark.parametrize("name", ["deq-mcl", "dead-reckoning"])
def test_a_replayed_lap_is_the_lap_but_for_the_rounding_of_its_odometry(name):
    trial = Trial(scenario="sharp", localizer=name, params=(), lag=20, seed=5, trial=0)
    setup = scenario("sharp")
    room = setup.room()
    live = list(Stage.of(trial).moments())
    log = Log.of_episode(
        [moment.ranges for moment in live],
        [moment.action for moment in live[1:]],
        [moment.truth for moment in live],
        room.lidar,
        unit="px",
    )
    env = LogEnv(log=log, map=room.floor_plan, horizon=len(log))
    agent, localizer = make_agent("open-loop", None), make(name, setup.robot_model(room))
    prior = partial(setup.prior_in, room)
    again = list(moments(env, agent, localizer, prior, trial.filter_rng(), seed=0))
    assert len(again) == len(live)
    for one, other in zip(live, again, strict=True):
        for mine, theirs in zip(one.belief.points(), other.belief.points(), strict=True):
            # an increment between two poses is off by 1e-13 px, below float32 of the particles
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9)
