"""What another stack has estimated: the same poses and covariances from every format."""

import math
import warnings

import numpy as np
import pytest
from bags import ODOMETRY, bag, header, make, odometry, quaternion
from deqmcl_command import exit_code, lines
from refusals import refused

from deqmcl_gym import logs
from deqmcl_gym.logs.trajectory import read_estimate
from deqmcl_gym.validation import LogWarning

POSE, COVARIANT = (f"geometry_msgs/msg/Pose{word}Stamped" for word in ("", "WithCovariance"))
TIMES = np.array([0.5, 1.25, 2.0])
POSES = np.array([[1.0, 2.0, 3.1], [1.5, 2.25, -3.1], [2.0, 2.5, -2.5]])
UPPER = ("var_x", "cov_xy", "cov_x_heading", "var_y", "cov_y_heading", "var_heading")


def covariances(n=3):
    roots = np.random.default_rng(0).normal(0, 0.3, (n, 3, 3))
    return roots @ roots.transpose(0, 2, 1)


def posed(time, pose, covariance=None, frame="map"):
    x, y, heading = pose
    at = make("geometry_msgs/msg/Point", x, y, 0.0)
    found = make("geometry_msgs/msg/Pose", at, quaternion(yaw=heading))
    if covariance is None:
        return make(POSE, header(time, frame), found)
    six = np.zeros((6, 6))
    six[np.ix_([0, 1, 5], [0, 1, 5])] = covariance
    six[[2, 3, 4], [2, 3, 4]] = 9.0  # z, roll and pitch are nothing of ours
    spread = make("geometry_msgs/msg/PoseWithCovariance", found, six.ravel())
    return make(COVARIANT, header(time, frame), spread)


def amcl_pose(path, given):
    rows = zip(TIMES, POSES, given, strict=True)
    return bag(path, *(("/amcl_pose", COVARIANT, posed(*row)) for row in rows))


def test_a_bag_a_csv_and_a_tum_file_say_the_same(tmp_path):
    given = covariances()
    upper = given[:, *np.triu_indices(3)]
    table = np.column_stack([TIMES, POSES, upper])
    header_ = ",".join(("time", "x", "y", "heading", *UPPER))
    rows = [",".join(map(repr, row)) for row in table.tolist()]
    (tmp_path / "x.csv").write_text("\n".join([header_, *rows]) + "\n")
    logs.Trajectory(TIMES, POSES).write(tmp_path / "x.tum")
    paths = amcl_pose(tmp_path / "x", given), tmp_path / "x.csv", tmp_path / "x.tum"
    for estimate in map(read_estimate, paths):
        np.testing.assert_array_equal(estimate.times, TIMES)
        np.testing.assert_allclose(estimate.poses, POSES, rtol=0, atol=1e-12)
        if estimate.covariances is not None:
            np.testing.assert_allclose(estimate.covariances, given, rtol=1e-14)
    assert estimate.covariances is None


def test_a_topic_is_asked_for_by_name_and_zeros_are_no_covariance(tmp_path):
    zeros = [("/amcl_pose", COVARIANT, posed(t, POSES[0], np.zeros((3, 3)))) for t in (1.0, 2.0)]
    other = [("/slam", POSE, posed(3.0, POSES[1])), ("/odom", ODOMETRY, odometry(0.0, 7.0))]
    path = bag(tmp_path / "x", *zeros, *other)
    assert read_estimate(path).times.tolist() == [1.0, 2.0]
    assert read_estimate(path).covariances is None
    assert read_estimate(path, "/slam").poses[0] == pytest.approx(POSES[1])
    with pytest.warns(LogWarning, match="in frame odom"):
        assert read_estimate(path, "/odom").poses[0] == pytest.approx([7.0, 0.0, 0.0])
    with refused("/scan", "/slam (geometry_msgs/msg/PoseStamped)"):
        read_estimate(path, "/scan")
    # odometry is no estimate of a stack that publishes one
    assert read_estimate(bag(tmp_path / "y", *other)).poses[0] == pytest.approx(POSES[1])
    with refused("2 topics", "FILE:TOPIC"):
        read_estimate(bag(tmp_path / "z", *other, ("/slam_2", POSE, other[0][2])))


@pytest.mark.parametrize(
    ("frame", "other"),
    [("map", ""), ("/map", ""), ("", ""), ("odom", "odom"), ("/odom", "odom"), ("a/map", "a/map")],
)
def test_poses_in_another_frame_than_the_map_s_are_warned_of(tmp_path, frame, other):
    path = bag(tmp_path / "x", ("/slam", POSE, posed(1.0, POSES[0], frame=frame)))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_estimate(path)
    said = [str(one.message) for one in caught if issubclass(one.category, LogWarning)]
    named = f"the poses of /slam in {path} are in frame {other}, but are taken as poses in map"
    assert [one.startswith(named) for one in said] == ([True] if other else [])


def test_poses_that_are_not_finite_are_left_out_and_counted(tmp_path):
    (tmp_path / "x.csv").write_text("time,x,y,heading\n1,0,0,0\n2,nan,0,0\n3,,0,0\n4,1,0,0\n")
    with pytest.warns(LogWarning, match="skipped 2 of 4 records"):
        assert read_estimate(tmp_path / "x.csv").times.tolist() == [1.0, 4.0]
    text = "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 0\n3 0 0\n\n# x\n4 nan 0 0 0 0 0 1\n5 0 0 0 0 0 1 0\n"
    (tmp_path / "x.tum").write_text(text)
    for read in (read_estimate, logs.read_tum):
        with pytest.warns(LogWarning, match="skipped 3 of 5"):
            assert read(tmp_path / "x.tum").times.tolist() == [1.0, 5.0]


REFUSED = [
    (read_estimate, "x.tum", "# nothing\n", "has no usable pose"),
    (logs.read_tum, "x.tum", "# nothing\n", "has no usable pose"),
    (read_estimate, "x.csv", "time,x,y\n1,2,3\n", "'heading' 0 times"),
    (read_estimate, "x.csv", "time,x,y,heading,var_x\n", "'cov_xy' 0 times"),
    (read_estimate, "x.csv", "time,x,y,heading\n1,2,3,4\n1,2\n", "line 3 of"),
    (read_estimate, "x.csv", "time,x,y,heading\n1,2,3,left\n", "line 2 of"),
    (lambda path: read_estimate(path, "/amcl_pose"), "x.tum", "", "no topic /amcl_pose"),
]


@pytest.mark.parametrize(("read", "name", "text", "words"), REFUSED)
def test_what_is_no_estimate_is_refused(tmp_path, read, name, text, words):
    (tmp_path / name).write_text(text)
    with refused(name, words):
        read(tmp_path / name)


@pytest.mark.parametrize("shape", [(3, 3), (2, 3, 2)])
def test_covariances_of_another_shape_are_refused_and_unknown_ones_kept(shape):
    with refused(str(shape), "(2, 3, 3)"):
        logs.Trajectory([1.0, 2.0], np.zeros((2, 3)), covariances=np.zeros(shape))
    unknown = np.full((1, 3, 3), math.nan)
    assert np.isnan(logs.Trajectory([1.0], np.zeros((1, 3)), covariances=unknown).covariances).all()


def test_the_command_scores_a_bag_s_amcl_pose_with_its_covariance(here):
    logs.Trajectory(TIMES, POSES).write("true.tum")
    spread = np.diag([0.04, 0.04, 0.01])
    off = POSES + np.array([0.2, 0.0, 0.0])  # one standard deviation
    rows = zip(TIMES, off, strict=True)
    bag(here / "nav", *(("/amcl_pose", COVARIANT, posed(*row, spread)) for row in rows))
    words = ("score", "nav:/amcl_pose", "--reference", "true.tum", "--out", "scored")
    assert exit_code(*words) == 0
    (row,) = lines(here / "scored", "results.csv")
    assert row["localizer"] == "amcl_pose"
    assert float(row["nees"]) == pytest.approx(1, rel=1e-3)
    assert [float(row[f"coverage_{p}"]) for p in (50, 80, 95)] == [1, 1, 1]
    assert float(row["position_median"]) == pytest.approx(0.2)
