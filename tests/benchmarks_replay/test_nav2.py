"""``replay --nav2``: all of a user's AMCL parameters are accounted for."""

import json
import os
import re
import tomllib
from pathlib import Path

import deqmcl_command
import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused

import localizers
from benchmarks.cli import main
from benchmarks.robots.nav2 import nav2_document, read_nav2, usual_params
from benchmarks.robots.replaying import planned
from benchmarks.setup.documents import sweep_text
from benchmarks.sweeps.sweepfile import read_sweep
from deqmcl_gym import logs
from localizers.models.nav2_motion import DifferentialMotion, OmniMotion

# As in a robot's bring-up, other nodes left in
BRINGUP = """
amcl: {ros__parameters: {
      use_sim_time: True, alpha1: 0.04, alpha2: 0.08, alpha3: 0.09, alpha4: 0.2, alpha5: 0.2,
      base_frame_id: "base_footprint", beam_skip_distance: 0.5, beam_skip_error_threshold: 0.9,
      beam_skip_threshold: 0.3, do_beamskip: false, global_frame_id: "map", lambda_short: 0.1,
      laser_likelihood_max_dist: 1.5, laser_max_range: 4.0, laser_min_range: -1.0,
      laser_model_type: "likelihood_field_prob", max_beams: 30, max_particles: 1500,
      min_particles: 300, odom_frame_id: "odom", pf_err: 0.04, pf_z: 0.98, kld_err: 0.05,
      recovery_alpha_fast: 0.1, recovery_alpha_slow: 0.001, resample_interval: 2,
      robot_model_type: "nav2_amcl::DifferentialMotionModel", save_pose_rate: 0.5,
      sigma_hit: 0.15, tf_broadcast: true, transform_tolerance: 1.0, update_min_a: 0.2,
      update_min_d: 0.1, z_hit: 0.6, z_max: 0.05, z_rand: 0.4, z_short: 0.05, scan_topic: scan,
      set_initial_pose: true, initial_pose: {x: 2.2, y: 1.0, z: 0.0, yaw: 0.1}}}
bt_navigator:
  ros__parameters:
    global_frame: map
local_costmap:
  local_costmap:
    ros__parameters:
      resolution: 0.05
"""
ELSEWHERE = {
    "bt: {}\namcl: {ros__parameters: {pf_z: 0.7}}": "amcl",
    "bt: {ros__parameters: {a: {b: 1, b: 2}}}": "bt.ros__parameters.a.b",
    "ns: {bt: {ros__parameters: {a: 1}}, bt: {ros__parameters: {a: 2}}}": "ns.bt.ros__parameters.a",
}
PARTS = st.lists(st.sampled_from(["*", "**", "amcl", "a", "b"]), min_size=1, max_size=4)


@pytest.fixture
def params(tmp_path):
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
    assert (found.settings["assumed.scan.sigma"], found.every) == (0.15, (0.025, 0.05))
    assert found.reading == {"max_range": 4.0}
    assert found.start == (2.2, 1.0, 0.1)
    assert found.notes[0].endswith("not used: kld_err (no parameter of Nav2's AMCL)")


def test_older_names_and_a_least_range_are_read(params):
    old = params("nav2_amcl::DifferentialMotionModel", "omnidirectional")
    assert read_nav2(old).params["robot_model_type"] == "nav2_amcl::OmniMotionModel"
    alphas = {"alpha1": 0.04, "alpha2": 0.08, "alpha3": 0.09, "alpha4": 0.2}
    assert read_nav2(old).motion == OmniMotion(**alphas, alpha5=0.2)
    assert read_nav2(params()).motion == DifferentialMotion(**alphas)
    near = params("laser_min_range: -1.0", "laser_min_range: 0.3")
    assert read_nav2(near).reading == {"max_range": 4.0, "min_range": 0.3}
    far = params("laser_max_range: 4.0", "laser_max_range: -1.0")
    assert read_nav2(far).reading == {}  # what the sensor says
    assert read_nav2(params("alpha1: 0.04", "alpha1: 4e-2")).motion.alpha1 == 0.04  # YAML 1.2


def test_the_sweep_file_is_toml_whatever_the_file_is_called_and_however_small_its_numbers(params):
    path = params("update_min_d: 0.1", "update_min_d: 0.00001")
    odd = path.rename(path.with_name("a\nb.yaml"))
    every = {"every": read_nav2(odd).every}
    told = tomllib.loads(sweep_text([read_nav2(odd).source], {}, {"world": every}))
    assert told["world"]["every"] == [2.5e-6, 0.05]


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


BAD = [
    ("amcl: {ros__parameters", "amcl: {parameters", "no node amcl"),
    ("ros__parameters", "parameters", "is it of ROS 1?"),
    ("pf_err: 0.04", "pf_err: small", "pf_err is 'small'"),
    ('"likelihood_field_prob"', '"beams"', "laser_model_type"),
    ("do_beamskip: false", "do_beamskip: 1", "do_beamskip is 1"),
    ("x: 2.2", "x: here", "initial_pose.x is 'here'"),
    ("yaw: 0.1", "yaw: 90", "initial_pose is (2.2, 1, 90), but its heading must be in radians"),
    ("bt_navigator:", "again: &a {deeper: *a}\nbt_navigator:", "has an alias"),
    ("update_min_a: 0.2", "update_min_a: 11.5", "update_min_a is 11.5"),  # degrees
    ("bt_navigator", "/robot2/amcl", "2 nodes of AMCL, /amcl, /robot2/amcl: choose one by --node"),
    ("use_sim_time: True", "use_sim_time: [", "is not YAML"),
    ("use_sim_time: True", "use_sim_time: " + "[" * 900, "is nested too deeply"),
]


@pytest.mark.parametrize(("old", "new", "named"), BAD)
def test_a_bad_file_is_refused_in_one_sentence(params, old, new, named):
    with refused(named):
        read_nav2(params(old, new))


def of_amcl(path, *lines):
    path.write_text("amcl:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in lines))
    return path


STRAYS = {  # what stands under initial_pose, and which names Nav2 does not know
    "initial_pose: [1.0, 2.0, 0.5]": ["initial_pose"],
    "initial_pose:": ["initial_pose"],
    "initial_pose: {x: 1.0, roll: 0.0, pitch: up}": ["initial_pose.roll", "initial_pose.pitch"],
    "initial_pose: {x: 1.0, position: {x: 2.0}}": ["initial_pose.position.x"],
    "initial_pose.x: 1.0\n    initial_pose.jaw: 1": ["initial_pose.jaw"],
    "initial_pose_a: 0.5": ["initial_pose_a"],
}


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("lines", STRAYS)
def test_what_nav2_ignores_of_the_start_is_a_note(tmp_path, lines, told):
    found = read_nav2(of_amcl(tmp_path / "x.yaml", f"set_initial_pose: {told}", lines))
    assert list(found.unused) == STRAYS[lines]
    assert all(name in "".join(found.notes) for name in STRAYS[lines])
    x = 1.0 if "x: 1.0" in lines else 0.0
    assert found.start == ((x, 0.0, 0.0) if told else None)
    assert (str(found.start) in "".join(found.notes)) == told


@pytest.mark.parametrize("quoted", [False, True])
@pytest.mark.parametrize(
    ("name", "right", "wrong", "kind"),
    [
        ("max_particles", "700", "700.0", "an integer"),
        ("recovery_alpha_slow", "0.0", "0", "a double"),
        ("initial_pose.yaw", "1.0", "1", "a double"),
        ("laser_max_range", "2.0", "2", "a double"),
        ("do_beamskip", "true", "'True'", "a bool"),
        ("set_initial_pose", "true", "'yes'", "a bool"),
    ],
)
def test_a_value_of_a_wrong_type_is_taken_with_a_note(tmp_path, name, right, wrong, kind, quoted):
    lines = {"set_initial_pose": "true", name: right}
    expected = read_nav2(of_amcl(tmp_path / "x.yaml", *(f"{n}: {v}" for n, v in lines.items())))
    lines[name] = f'"{right}"' if quoted else wrong
    found = read_nav2(of_amcl(tmp_path / "x.yaml", *(f"{n}: {v}" for n, v in lines.items())))
    (note,) = found.notes
    assert expected.notes == []
    assert f"taken, but of types that Nav2 refuses: {name} " in note
    assert note.endswith(f"(must be {kind})")
    assert (found.params, found.start) == (expected.params, expected.start)
    assert (found.reading, found.every) == (expected.reading, expected.every)


def test_a_turn_above_half_a_circle_is_taken_with_a_note(tmp_path):
    found = read_nav2(of_amcl(tmp_path / "x.yaml", "update_min_a: 6.28"))
    assert found.params["update_min_a"] == 6.28
    assert "no turn is enough" in found.notes[0]
    endless = read_nav2(of_amcl(tmp_path / "x.yaml", "laser_max_range: .inf"))
    assert (endless.reading, endless.notes) == ({}, [])


@pytest.mark.parametrize("value", ["$(var x)", "$(find-pkg-share a)/b", '"$(env X $(var y))"'])
def test_a_launch_substitution_that_is_needed_and_has_no_default_is_refused(tmp_path, value):
    given = read_nav2(of_amcl(tmp_path / "x.yaml", "pf_z: $(env  X '0.9')"))
    assert given.params == {**usual_params(), "pf_z": 0.9}
    assert "pf_z " in given.notes[0]
    for name in ("alpha1", "laser_max_range"):
        with refused(name, value.strip('"'), "launch substitution", "`ros2 param dump`"):
            read_nav2(of_amcl(tmp_path / "x.yaml", f"{name}: {value}"))
    found = read_nav2(of_amcl(tmp_path / "x.yaml", f"scan_topic: {value}"))
    assert list(found.unused) == ["scan_topic"]
    for name in ("set_initial_pose", "initial_pose.x"):
        lines = {"set_initial_pose": "true", "initial_pose.y": "1.0", name: value}
        found = read_nav2(of_amcl(tmp_path / "x.yaml", *(f"{n}: {v}" for n, v in lines.items())))
        assert found.start is None
        assert f"not used: {name} (a launch substitution: no start is taken)" in found.notes[0]


@pytest.mark.parametrize("text", ELSEWHERE)
def test_a_key_that_is_given_twice_is_a_note_and_the_later_counts(tmp_path, text):
    path = of_amcl(tmp_path / "x.yaml", "pf_z: 0.9")
    path.write_text(f"{text}\n{path.read_text()}")
    found = read_nav2(path)
    assert found.params == {**usual_params(), "pf_z": 0.9}
    (note,) = found.notes
    assert note.split(": ")[-1].split(", ")[0] == ELSEWHERE[text]
    document = nav2_document({"pf_z": 0.8}, path)
    assert document["amcl"]["ros__parameters"]["pf_z"] == 0.8
    assert [name for name in ("bt", "ns") if name in document]


@settings(max_examples=100, deadline=None)
@given(
    st.lists(PARTS, min_size=1, max_size=5, unique_by=tuple),
    st.lists(st.sampled_from(["a", "b"]), max_size=3),
    st.randoms(use_true_random=False),
)
def test_nodes_and_wildcards_that_fit_apply_in_order(tmp_path_factory, patterns, namespace, random):
    name = "/".join(["", *namespace, "amcl"])
    lines, last = [], None
    for i, parts in enumerate(patterns):
        cut = random.randint(0, len(parts) - 1)  # the namespace before it stands in a line above
        above, below = "/".join(["", *parts[:cut]]), "/".join(parts[cut:])
        node = f"{{ros__parameters: {{pf_z: 0.{i + 1}, only{i}: 1}}}}"
        lines.append(f"'{above}': {{'{below}': {node}}}" if cut else f"'/{below}': {node}")
        regex = ("/" + "/".join(parts)).replace("/*", "(/\\w+)")  # as rclcpp's parameter_map.cpp
        last = i if re.fullmatch(regex, name) else last
    path = tmp_path_factory.mktemp("nav2") / "x.yaml"
    path.write_text("\n".join(lines))
    if len({line.split(":")[0] for line in lines}) < len(lines):
        return  # joined, at the first one's place
    if last is None:
        with refused(f"node of {path}"):
            read_nav2(path, name)
        return
    assert read_nav2(path, name).params["pf_z"] == (last + 1) / 10
    written = nav2_document({"pf_z": 0.95}, path, name)
    path.write_text(yaml.safe_dump(written, sort_keys=False))
    assert read_nav2(path, name).params["pf_z"] == 0.95


@pytest.mark.parametrize(
    ("nodes", "name"),
    [
        (["/**"], "/amcl"),
        (["'**'"], "/amcl"),
        (["/*/amcl"], "/*/amcl"),
        (["/**", "/robot1/**"], "/robot1/amcl"),
        (["/robot1/amcl", "/**"], "/robot1/amcl"),
        (["/**", "bt_navigator"], "/amcl"),
        (["$(var ns)/amcl", "/**"], "/$(var ns)/amcl"),
        (["/robot1/**", "/robot2/**"], "2 nodes of AMCL, /robot1/amcl, /robot2/amcl"),
        (["bt_navigator", "/**/controller"], "no node amcl"),
    ],
)
def test_wildcards_alone_have_the_amcl_that_most_of_them_fit(tmp_path, nodes, name):
    path = tmp_path / "x.yaml"
    node = "{ros__parameters: {pf_z: 0.9}}"
    path.write_text("\n".join(f"{pattern}: {node}" for pattern in nodes))
    if not name.startswith("/"):
        with refused(name, "--node"):
            read_nav2(path)
        return
    found = read_nav2(path)
    assert found.source.endswith(f"node {name}")
    assert found.params["pf_z"] == 0.9
    path.write_text(yaml.safe_dump(nav2_document({"pf_z": 0.8}, path), sort_keys=False))
    assert read_nav2(path, name).params["pf_z"] == 0.8


def test_a_wildcard_that_overrides_amcl_is_told_and_a_typing_error_is_no_node(tmp_path):
    path = tmp_path / "x.yaml"
    own = "amcl: {ros__parameters: {pf_z: 0.9, z_hit: 0.4}}\n"
    path.write_text(own + "/**: {ros__parameters: {pf_z: 0.8, use_sim_time: true}}")
    found = read_nav2(path)
    (note,) = found.notes
    assert note.endswith("overridden by a wildcard that stands after /amcl, as in rclcpp: pf_z")
    assert read_nav2(path, "/robot1/amcl").params == {**usual_params(), "pf_z": 0.8}
    with refused("/acml", "did you mean '/amcl'"):
        read_nav2(path, "acml")


def test_a_missing_file_or_node_is_refused(params, tmp_path):
    with refused("does not exist"):
        read_nav2(tmp_path / "none.yaml")
    with refused("/bt_navigator"):
        read_nav2(params(), "acml")


def test_the_sweep_file_runs_as_it_is_printed_with_a_log_in_it(params, recorded, capsys):
    command = ["replay", "lap.csv", "--map", "hall.yaml", "--nav2", str(params()), "--seeds", "1"]
    command += ["--localizers", "amcl,mcl-smoother", "--set", "params.amcl.max_particles=400"]
    assert main([*command, "--dry-run"]) == 0
    Path("amcl.toml").write_text(capsys.readouterr().out)
    assert os.listdir() != ["results"]
    printed = read_sweep(Path("amcl.toml"))
    told = {"settings": {"params.amcl.max_particles": 400}, "nav2": [read_nav2(params())]}
    plan = planned("lap.csv", "hall.yaml", ("amcl", "mcl-smoother"), seeds=1, **told)
    assert (printed.world, printed.assumed) == (plan.sweep.world, plan.sweep.assumed)
    amcl, smoother = printed.distinct()
    assert amcl == plan.sweep.distinct()[0]
    assert smoother.params["lag"] == 20  # as without the file, where it is the localizer's own
    assert main(["sweep", "amcl.toml", "--dry-run"]) == 0


def test_replay_takes_the_same_file_and_says_what_it_leaves_out(params, recorded, capsys):
    rare = params("update_min_d: 0.1", "update_min_d: 1.0")
    command = ["replay", "lap.csv", "--map", "hall.yaml", "--nav2", str(rare), "--seeds", "1"]
    told = [*command, "--particles", "20", "--localizers", "amcl,dead-reckoning", "--jobs", "1"]
    assert main([*told, "--out", "out"]) == 0
    said = capsys.readouterr()
    assert "not used: kld_err" in said.err
    assert "Warning: --particles 20 is not of amcl, which has the file's, " in said.err
    assert "differential, alpha1 0.04, alpha2 0.08, alpha3 0.09, alpha4 0.2" in said.out
    assert "around (2.20, 1.00, 0.10 rad)" in said.out
    assert f"{len(logs.read('lap.csv').spaced(0.25, 0.05))} records" in said.out
    rows = deqmcl_command.lines(Path("out"), "results.csv")
    assert [row["localizer"] for row in rows] == ["amcl", "dead-reckoning"]
    assert main([*command, "--node", "nobody", "--out", "other"]) == 2


def test_several_files_are_rows_of_one_table_compared_with_the_first(recorded, capsys):
    for name, sigma, beams in (("a", 0.1, 30), ("b", 0.3, 20), ("same", 0.1, 30)):
        of_amcl(Path(f"{name}.yaml"), f"sigma_hit: {sigma}", f"max_beams: {beams}")
    command = ["replay", "lap.csv", "--map", "hall.yaml", "--reference", "lap.tum", "--seeds", "2"]
    files = (word for name in ("a", "b", "same") for word in ("--nav2", f"{name}.yaml"))
    several = [*command, *files]
    told = [*several, "--set", "params.amcl.pf_err=0.2", "--jobs", "1", "--out", "out"]
    assert main(told) == 0
    said = capsys.readouterr().out
    table = pd.read_csv("out/results.csv", index_col="localizer")
    assert [*table.index] == ["mcl", "amcl (a = same)", "amcl (b)"]
    assert table["position_median_diff"].notna().tolist() == [True, False, True]
    assert "20 beams" not in said
    assert "30 beams" in said
    with (Path("out/manifest.json")).open() as file:
        methods = json.load(file)["identity"]["sweep"]["localizers"]
    assert [one["params"].get("pf_err") for one in methods] == [None, 0.2, 0.2]
    assert main(["score", "lap.tum", "--beside", "out", "--out", "beside"]) == 0
    assert [*pd.read_csv("beside/results.csv")["localizer"]] == [*table.index, "lap"]
    capsys.readouterr()
    assert main([*told, "--dry-run"]) == 0  # a sweep file keeps the names
    Path("both.toml").write_text(capsys.readouterr().out)
    assert [one.label for one in read_sweep(Path("both.toml")).localizers] == ["", *table.index[1:]]
    assert main([*told, "--fail-if", "amcl (b).position_p95 > 0"]) == 4
    refusals = {
        "add it to --localizers": ["--localizers", "mcl"],
        "names a file twice": ["--nav2", "b.yaml"],
        "did you mean 'amcl (b)'?": ["--fail-if", "amcl b.position_p95 > 0.2"],
    }
    for sentence, words in refusals.items():
        assert main([*several, *words]) == 2
        assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--set", "params.amcl.alpha1=0.3"], "alpha1 0.04 → 0.3"),
        (["--every", "0.2m,1rad"], "update_min_a 0.2 → 1.0, update_min_d 0.1 → 0.2"),
        (
            ["--reference", "far.tum"],
            "initial_pose (2.2, 1.0, 0.1) → the reference's first pose (1.90, 1.00, 0.00)",
        ),
        (["--reference", "lap.tum"], None),
        (["--start=global"], "initial_pose (2.2, 1.0, 0.1) → another start"),
        (["--start=2.2,1,0.1", "--particles", "20", "--set", "assumed.motion.alpha1=0.5"], None),
    ],
)
def test_replay_says_where_amcl_differs_from_the_file(params, recorded, capsys, words, told):
    command = ["replay", "lap.csv", "--map", "hall.yaml", "--nav2", str(params()), "--seeds", "1"]
    times, poses = (whole := logs.read_tum("lap.tum")).times, whole.poses
    logs.Trajectory(times, poses - np.array([0.4, 0, 0])).write("far.tum")
    assert main([*command, "--localizers", "amcl", *words, "--dry-run"]) == 0
    said = capsys.readouterr().err
    assert ("what is played differs in" in said) == (told is not None)
    assert told is None or f"node /amcl: what is played differs in {told}" in " ".join(said.split())
