"""``deqmcl from-nav2``, ``replay --nav2``: all of a user's AMCL parameters are accounted for."""

import csv
import tomllib
from pathlib import Path

import numpy as np
import pytest
import yaml

import localizers
from benchmarks.cli import main
from benchmarks.replay.nav2 import read_nav2
from benchmarks.sweeps.sweepfile import read_sweep
from deqmcl_gym import logs
from deqmcl_gym.envs.log import spacing
from deqmcl_gym.maps import GridMap
from deqmcl_gym.validation import InputError
from localizers.models.nav2_motion import DifferentialMotion, OmniMotion

# As in a robot's bring-up, other nodes left in
BRINGUP = """
amcl:
  ros__parameters:
    use_sim_time: True
    alpha1: 0.04
    alpha2: 0.08
    alpha3: 0.09
    alpha4: 0.2
    alpha5: 0.2
    base_frame_id: "base_footprint"
    beam_skip_distance: 0.5
    beam_skip_error_threshold: 0.9
    beam_skip_threshold: 0.3
    do_beamskip: false
    global_frame_id: "map"
    lambda_short: 0.1
    laser_likelihood_max_dist: 1.5
    laser_max_range: 4.0
    laser_min_range: -1.0
    laser_model_type: "likelihood_field_prob"
    max_beams: 30
    max_particles: 1500
    min_particles: 300
    odom_frame_id: "odom"
    pf_err: 0.04
    pf_z: 0.98
    kld_err: 0.05
    recovery_alpha_fast: 0.1
    recovery_alpha_slow: 0.001
    resample_interval: 2
    robot_model_type: "nav2_amcl::DifferentialMotionModel"
    save_pose_rate: 0.5
    sigma_hit: 0.15
    tf_broadcast: true
    transform_tolerance: 1.0
    update_min_a: 0.2
    update_min_d: 0.1
    z_hit: 0.6
    z_max: 0.05
    z_rand: 0.4
    z_short: 0.05
    scan_topic: scan
    set_initial_pose: true
    initial_pose: {x: 1.2, y: 1.0, z: 0.0, yaw: 0.1}
bt_navigator:
  ros__parameters:
    global_frame: map
local_costmap:
  local_costmap:
    ros__parameters:
      resolution: 0.05
"""


@pytest.fixture
def params(tmp_path):
    """A function that writes a parameter file, some of its lines changed."""

    def written(old="", new=""):
        assert old in BRINGUP
        path = tmp_path / "nav2_params.yaml"
        path.write_text(BRINGUP.replace(old, new) if old else BRINGUP)
        return path

    return written


def test_every_parameter_is_used_or_named_with_the_reason(params):
    path = params()
    given = yaml.safe_load(BRINGUP)["amcl"]["ros__parameters"]
    found = read_nav2(path)
    elsewhere = {"laser_max_range", "laser_min_range", "set_initial_pose", "initial_pose"}
    assert given.keys() == found.params.keys() | found.unused.keys() | elsewhere
    for name in found.params:
        assert found.params[name] == given[name]
    assert "no parameter of Nav2's AMCL" in found.unused["kld_err"]
    assert (found.sigma, found.every) == (0.15, (0.025, 0.05))
    assert found.reading == {"max_range": 4.0}
    assert found.start == (1.2, 1.0, 0.1)
    assert found.notes[0].endswith("not used: kld_err")


def test_older_names_and_a_least_range_are_read(params):
    old = params("nav2_amcl::DifferentialMotionModel", "omnidirectional")
    assert read_nav2(old).params["robot_model_type"] == "nav2_amcl::OmniMotionModel"
    near = params("laser_min_range: -1.0", "laser_min_range: 0.3")
    assert read_nav2(near).reading == {"max_range": 4.0, "min_range": 0.3}
    far = params("laser_max_range: 4.0", "laser_max_range: -1.0")
    assert read_nav2(far).reading == {}  # what the sensor says
    assert read_nav2(params("alpha1: 0.04", "alpha1: 4e-2")).motion.alpha1 == 0.04  # YAML 1.2


def test_the_sweep_file_is_toml_whatever_the_file_is_called_and_however_small_its_numbers(params):
    path = params("update_min_d: 0.1", "update_min_d: 0.00001")
    odd = path.rename(path.with_name("a\nb.yaml"))
    told = tomllib.loads(read_nav2(odd).toml)
    assert spacing("every", told["world"]["every"], "m") == (2.5e-6, 0.05)


def test_the_motion_is_navs_model_with_the_files_parameters(params):
    alphas = {"alpha1": 0.04, "alpha2": 0.08, "alpha3": 0.09, "alpha4": 0.2}
    assert read_nav2(params()).motion == DifferentialMotion(**alphas)
    omni = params("Differential", "Omni")
    assert read_nav2(omni).motion == OmniMotion(**alphas, alpha5=0.2)


def test_what_is_not_given_has_navs_defaults(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text("amcl: {ros__parameters: {use_sim_time: false}}")
    found = read_nav2(path)
    ours = {"selective_resampling", "field_cell"}
    assert {*found.params, *ours} == set(localizers.parameters("amcl"))
    assert found.params["lambda_short"] == 0.1
    assert found.params["max_beams"] == 60
    assert found.motion == DifferentialMotion()
    assert found.start is None
    assert found.notes == []


@pytest.mark.parametrize(
    "text",
    [
        "/robot1/amcl: {ros__parameters: {pf_err: 0.02}}",
        "robot1: {amcl: {ros__parameters: {pf_err: 0.02}}}",
        "/robot1: {amcl: {ros__parameters: {pf_err: 0.02}}}",
        "/**: {ros__parameters: {pf_err: 0.02}}\n/robot1/amcl: {ros__parameters: {pf_z: 0.9}}",
    ],
)
def test_namespaces_are_found_however_they_are_written(tmp_path, text):
    path = tmp_path / "x.yaml"
    path.write_text(text)
    for node in (None, "/robot1/amcl", "robot1/amcl"):
        assert read_nav2(path, node).params["pf_err"] == 0.02


BAD = [
    ("amcl:\n  ros__parameters", "amcl:\n  parameters", "no node amcl"),
    ("pf_err: 0.04", "pf_err: small", "pf_err is 'small'"),
    ("pf_err: 0.04", "pf_err: 0.0", "pf_err"),
    ("alpha1: 0.04", "alpha1: -0.04", "alpha1 is -0.04"),
    ("max_beams: 30", "max_beams: 30.5", "max_beams is 30.5"),
    ("max_particles: 1500", "max_particles: 100", "min_particles is 300"),
    ('"likelihood_field_prob"', '"beams"', "laser_model_type"),
    ("DifferentialMotionModel", "Differential", "robot_model_type"),
    ("do_beamskip: false", "do_beamskip: 1", "do_beamskip is 1"),
    ("beam_skip_threshold: 0.3", "beam_skip_threshold: 30", "beam_skip_threshold is 30"),
    ("max_beams: 30", "max_beams: 1", "max_beams is 1"),
    ("set_initial_pose: true", "set_initial_pose: 1", "set_initial_pose is 1"),
    ("x: 1.2", "x: here", "initial_pose is ['here', 1.0, 0.1]"),
    ("yaw: 0.1", "yaw: 90", "initial_pose is (1.2, 1, 90), but its heading must be in radians"),
    ("bt_navigator:", "again: &a {deeper: *a}\nbt_navigator:", "has an alias"),
    ("update_min_d: 0.1", "update_min_d: -1", "update_min_d is -1"),
    ("update_min_a: 0.2", "update_min_a: -0.2", "update_min_a is -0.2"),
    ("update_min_a: 0.2", "update_min_a: 11.5", "update_min_a is 11.5"),  # degrees
    ("pf_z: 0.98", "pf_z: -1", "pf_z is -1"),
    ("sigma_hit: 0.15", "sigma_hit: 0", "sigma_hit is 0"),
    ("laser_max_range: 4.0", "laser_max_range: .nan", "laser_max_range is nan"),
    ("{x: 1.2, y: 1.0, z: 0.0, yaw: 0.1}", "[1.2, 1.0, 0.1]", "initial_pose is [1.2"),
    ("yaw: 0.1", "theta: 0.1", "name in initial_pose 'theta'"),
    (
        "set_initial_pose: true",
        "set_initial_pose: true\n    initial_pose.jaw: 1",
        "did you mean 'yaw'",
    ),
    ("bt_navigator", "/robot2/amcl", "2 nodes of AMCL, /amcl, /robot2/amcl: choose one by --node"),
    ("use_sim_time: True", "use_sim_time: [", "is not YAML"),
    ("use_sim_time: True", "use_sim_time: " + "[" * 9000, "is nested too deeply"),
]


@pytest.mark.parametrize(("old", "new", "named"), BAD)
def test_a_bad_file_is_refused_in_one_sentence(params, capsys, old, new, named):
    assert main(["from-nav2", str(params(old, new))]) == 2
    said = capsys.readouterr()
    assert named in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""


def test_a_missing_file_or_node_is_refused(params, tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read_nav2(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="/bt_navigator"):
        read_nav2(params(), "acml")


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """The current folder, with a room of cells and what a robot that stood in it saw."""
    monkeypatch.chdir(tmp_path)
    cells = np.zeros((60, 80), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[20:30, 40:50] = 100
    room = GridMap(occupancy=cells, resolution=0.05)
    room.save("room.yaml")
    scanner = logs.Scanner(angles=tuple(np.linspace(-2, 2, 40)), max_range=8.0)
    poses = np.column_stack([np.linspace(1.0, 1.5, 30), np.ones(30), np.zeros(30)])
    ranges = room.ranges(poses, scanner.bearings)
    log = logs.Log(scanner, np.arange(30.0), poses, ranges)
    logs.write(log, "x.csv")
    logs.Trajectory(log.times, poses).write("x.tum")


def test_the_sweep_file_runs_as_it_is_printed_with_a_log_in_it(params, recorded, capsys):
    assert main(["from-nav2", str(params())]) == 0
    text = capsys.readouterr().out
    text = text.replace('# log = "robot.log.gz"', 'log = "x.csv"\nsegment = 0.3')
    text = text.replace('# map = "map.yaml"', 'map = "room.yaml"')
    text = text.replace('# reference = "robot.tum"', 'reference = "x.tum"')
    Path("amcl.toml").write_text(
        "trials = 1\n" + text.replace("max_particles = 1500", "max_particles = 400")
    )
    trial, *_ = read_sweep(Path("amcl.toml")).distinct()
    taken = localizers.parameters("amcl")
    assert dict(trial.params).keys() <= set(taken)
    assert main(["sweep", "amcl.toml", "--dry-run"]) == 0


def test_replay_takes_the_same_file_and_says_what_it_leaves_out(params, recorded, capsys):
    command = ["replay", "x.csv", "--map", "room.yaml", "--nav2", str(params()), "--seeds", "1"]
    told = [*command, "--particles", "20", "--localizers", "amcl,dead-reckoning", "--jobs", "1"]
    assert main([*told, "--out", "out"]) == 0
    said = capsys.readouterr()
    assert "not used: kld_err" in said.err
    assert "differential, alpha1 0.04, alpha2 0.08, alpha3 0.09, alpha4 0.2" in said.out
    assert "around (1.20, 1.00, 0.10 rad)" in said.out
    assert "15 records" in said.out  # 0.5 m, a record each 17 mm, of which two make 25 mm
    with open("out/results.csv", newline="") as file:
        assert [row["localizer"] for row in csv.DictReader(file)] == ["amcl", "dead-reckoning"]
    assert main([*command, "--node", "nobody", "--out", "other"]) == 2
