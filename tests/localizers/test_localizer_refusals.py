"""Bad parameters and inputs are refused on one line and change nothing; odd scans are counted."""

import math
from dataclasses import replace

import numpy as np
import pytest
from following import follow, same
from refusals import refused

import localizers
from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.validation import InputError
from localizers import (
    AnnulusRegion,
    BeamModel,
    Calibration,
    CensoredGaussianUniform,
    GaussianPrior,
    GaussianUniform,
    LatentShare,
    MixturePrior,
    OdometryMotion,
    PolygonRegion,
    RobotModel,
    UniformPrior,
)
from localizers.models.nav2_motion import DifferentialMotion, OmniMotion

NAN, INF = math.nan, math.inf
SCANS = (GaussianUniform, CensoredGaussianUniform, BeamModel, LatentShare)
NARROW = PolygonMap(outer=[(0, 0), (10, 0), (10, 300), (0, 300)])
HERE, AWAY = GaussianPrior(mean=(1, 2, 0)), AnnulusRegion(centre=(50.0, 3.0), within=1.0)
RNG = np.random.default_rng
PARAMETERS = [(name, word) for name in localizers.names() for word in localizers.parameters(name)]
NEGATIVE = [one for one in PARAMETERS if one != ("amcl", "pf_z")]  # a quantile may be


@pytest.mark.parametrize(
    ("name", "params", "words"),
    [
        ("mcl", {"particles": 10**9}, "particles is 1000000000, but must be a whole number from 1"),
        ("mcl", {"resampler": "low-variance"}, "multinomial, stratified, systematic"),
        ("mcl", {"ess_threshold": 1.1}, "ess_threshold is 1.1, but must be a number from 0 to 1"),
        ("mcl-map", {"inflation_radius": 7}, "robot's centre) is 7, but must be a number of 8"),
        ("mcl-map", {"cost_scaling_factor": 0.1}, "used only with an inflation_radius"),
        ("mcl-h", {}, "mcl-h is gone: use deq-mcl-fresh, which has its error."),
        ("deq-mcl-fresh", {"keep": 0.5}, "keep is 0.5, but it is used only with evidence = 'plan'"),
        ("deq-mcl-fresh", {"evidence": "x"}, "unknown evidence 'x': allowed values: future, plan."),
        ("dead-reckoning", {"particles": 10}, "none"),
        (None, {}, "unknown localizer None"),
        ("grid", {"cell": 0.5}, "at most 1 GiB"),
        ("grid", {"headings": 10**400}, "a whole number from 4 to 100,000"),
        ("grid", {"cell": 1e-310}, "cell is 1e-310"),
        ("amcl", {"min_particles": 3000}, "(at most max_particles) is 3000, but must"),
        ("amcl", {"recovery_alpha_slow": 0.1}, "(at least recovery_alpha_slow) is 0"),
        ("amcl", {"selective_resampling": "yes"}, "selective_resampling is 'yes'"),
        ("amcl", {"z_hit": 0, "z_rand": 0}, "one must be above 0"),
        ("amcl", {"field_cell": 1e-3}, "give larger cells"),
        ("amcl", {"field_cell": 1e-5}, "field_cell makes a table of"),
        ("cbgl", {"poses": 20, "matched": 30}, "(of the poses that are drawn) is 30, but must"),
        ("cbgl", {"modes": 11}, "(of the poses that are matched) is 11, but must"),
        ("cbgl", {"start_draws": 20}, "unknown parameter of localizer 'cbgl'"),
    ],
)
def test_a_bad_parameter_is_refused_with_what_is_allowed(robot, name, params, words):
    with refused(words):
        localizers.make(name, robot, **params)


@pytest.mark.parametrize(
    ("name", "parameter", "bad"),
    [*((*one, NAN) for one in PARAMETERS), *((*one, -1) for one in NEGATIVE)],
)
def test_no_parameter_may_be_nan_or_negative(robot, name, parameter, bad):
    its_use = {"laser_model_type": "beam"} if parameter == "lambda_short" else {}
    with refused(parameter):
        localizers.make(name, robot, **its_use, **{parameter: bad})


@pytest.mark.parametrize(
    ("name", "part", "model", "words"),
    [
        ("ekf", "scan", object(), "hit_moments"),
        ("ekf", "motion", object(), "an OdometryMotion"),
        ("grid", "motion", OmniMotion(), "OdometryMotion"),
    ],
)
def test_a_model_without_what_the_method_needs_is_refused(robot, name, part, model, words):
    with refused(words):
        localizers.make(name, replace(robot, **{part: model}))


BAD_MODELS = [
    *((model, {"sigma": 0}, ("scan.sigma is 0", "above 0.")) for model in SCANS),
    (CensoredGaussianUniform, {"uniform": -0.1}, ("scan.uniform is ", "from 0 to 1.")),
    (LatentShare, {"concentration": 0}, ("scan.concentration is 0", "above 0.")),
    (GaussianUniform, {"power": 0}, ("scan.power is ",)),
    (BeamModel, {"hit": 0.9}, ("must add up to 1",)),
    (BeamModel, {"decay": 0}, ("scan.decay is 0",)),
    (OdometryMotion, {"drift": "a"}, ("motion.drift is ", " number of 0 or more.")),
    *((model, {"alpha2": -0.1}, ("alpha2 is ",)) for model in (DifferentialMotion, OmniMotion)),
    *((GaussianPrior, {"mean": bad}, ("prior",)) for bad in ((1, 2), (1, 2, 90), "a")),
    (GaussianPrior, {"mean": (1, 2, 0), "sd_heading": NAN}, ("prior",)),
    (UniformPrior, {"floor_plan": NARROW, "radius": 8}, ("prior.radius is 8", "does not fit")),
    (UniformPrior, {"floor_plan": NARROW, "region": AWAY}, ("fit into the AnnulusRegion",)),
    (PolygonRegion, {"corners": ((0, 0), (1, 0))}, ("2 corners",)),
    (PolygonRegion, {"corners": ((0, 0), (2, 2), (2, 0), (0, 2))}, ("crosses or touches itself",)),
    (PolygonRegion, {"corners": ((0, 0), (1, 0), (1, 1), (0, 0))}, ("zero length",)),
    (AnnulusRegion, {"centre": (0, 0), "within": 1, "beyond": 1}, ("prior.within",)),
    (AnnulusRegion, {"centre": (0,), "within": 1}, ("prior's centre",)),
    (MixturePrior, {"parts": ()}, ("no part",)),
    (MixturePrior, {"parts": (HERE,), "weights": (0.0,)}, ("above 0",)),
    (MixturePrior, {"parts": (HERE,), "weights": (1.0, 2.0)}, ("weights of priors",)),
    (Calibration, {"scale": -1.0}, ("scale of a calibration is -1,",)),
    (Calibration, {"position": NAN}, ("position of a calibration",)),
    (Calibration, {"heading": "5°"}, ("heading of a calibration",)),
    (RobotModel, {"floor_plan": NARROW, "lidar": Lidar(), "radius": -1}, ("radius is",)),
    (RobotModel, {"floor_plan": None, "lidar": Lidar()}, ("floor_plan is None", "a Map")),
    (RobotModel, {"floor_plan": NARROW, "lidar": None}, ("lidar is None", "a Lidar")),
]


@pytest.mark.parametrize(("model", "params", "words"), BAD_MODELS)
def test_a_model_or_a_prior_that_cannot_be_is_refused_by_its_field(model, params, words):
    with refused(*words):
        model(**params)


@pytest.mark.parametrize("name", localizers.names())
def test_what_none_can_start_from_or_do_is_refused_by_every_localizer(robot, name):
    localizer, prior = localizers.make(name, robot), GaussianPrior(mean=(50, 50, 0))
    scan = np.full(robot.lidar.beams, 100.0)
    with pytest.raises(RuntimeError, match=r"call reset\(prior, plan, rng\) first"):
        localizer.update(scan, [5.0, 0.0], [])
    with refused("the prior is "):
        localizer.reset(None, [], RNG(0))
    for rng in (0, None, np.random, np.random.RandomState(0)):
        with pytest.raises(InputError, match=r"^rng is .*, but must be a numpy\.random\.Generator"):
            localizer.reset(prior, [], rng)
    for huge in ((1e30, 0), (0, -1e30), (1e300, 1e300)):
        localizer.reset(prior, [huge][:0], RNG(0))
        for action, plan in ((huge, []), ((1.0, 0.0), [huge])):
            with pytest.raises(InputError, match=r"but (the largest allowed is|must be) .*1e\+"):
                localizer.update(scan, np.array(action), np.reshape(plan, (-1, 2)))


BAD_INPUTS = [
    *[("action", bad) for bad in (None, "ab", [0, INF], [], [1, 2, 3, 4])],
    *[("plan", bad) for bad in ("abc", [1, 2], [[1, 2], [3]], [[1, NAN]], np.ones((4, 4)))],
    *[("scan", bad) for bad in (None, ["a"], [1, 2], [[1], [2, 3]], np.ones((1, 2)))],
]


@pytest.mark.parametrize("name", ["deq-mcl", "dead-reckoning"])
@pytest.mark.parametrize("plan", [None, 5.0])
def test_a_bad_plan_is_refused_at_reset_and_the_localizer_stays_unstarted(robot, prior, name, plan):
    localizer, rng = localizers.make(name, robot), RNG(0)
    with refused("the plan"):
        localizer.reset(prior, plan, rng)
    with pytest.raises(RuntimeError):
        localizer.update([100.0], [5.0, 0.0], [])
    assert rng.bit_generator.state == RNG(0).bit_generator.state


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.float16])
def test_numbers_of_any_kind_make_the_same_localizer(robot, prior, drive, kind):
    whole = int if kind is np.float16 else kind
    params = {"particles": whole(100), "start_draws": whole(4), "plan_beta": kind(2)}
    sensor = replace(robot, scan=GaussianUniform(sigma=kind(100)))
    own = localizers.make("mcl-map", sensor, **params)
    given = replace(robot, scan=GaussianUniform(sigma=100.0))
    plain = localizers.make("mcl-map", given, particles=100, start_draws=4, plan_beta=2.0)
    assert same(follow(own, prior, drive), follow(plain, prior, drive))


@pytest.mark.parametrize(("what", "bad"), BAD_INPUTS, ids=str)
def test_a_bad_input_to_update_is_refused_and_changes_nothing(robot, prior, drive, what, bad):
    actions, scans = drive
    localizer = localizers.make("deq-mcl", robot, particles=50)
    localizer.reset(prior, actions, RNG(0))
    good = {"scan": scans[0], "action": actions[0], "plan": actions[1:]}
    with refused(f"the {what}"):
        localizer.update(*{**good, what: bad}.values())
    fresh = localizers.make("deq-mcl", robot, particles=50)
    undisturbed = follow(fresh, prior, (actions[:1], scans[:1]), plans=[actions, actions[1:]])
    assert same([localizer.update(*good.values())], undisturbed[1:], offsets=range(-2, 13))


@pytest.mark.parametrize("bad", [NAN, -INF, -0.5, 400.5])
def test_bad_beams_are_counted_and_an_all_bad_scan_is_no_update(room, prior, bad):
    robot = localizers.RobotModel(floor_plan=room, lidar=Lidar(beams=2))
    localizer = localizers.make("mcl", robot, particles=40)
    localizer.reset(prior, [], RNG(0))
    belief = localizer.update([bad, bad], [5.0, 0.0], [])
    assert (belief.events.skipped_beams, belief.events.blind_scans) == (2, 1)
    assert belief.points()[1].tolist() == [1 / 40] * 40
    after = localizer.update([200.0, bad], [5.0, 0.0], [])
    assert (after.events.skipped_beams, after.events.blind_scans) == (3, 1)
    assert np.ptp(after.points()[1]) > 0
