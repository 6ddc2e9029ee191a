"""APE and RPE are evo's, of our TUM files."""

import numpy as np
import pytest

from benchmarks.trials.tracks import absolute, relative_errors
from deqmcl_gym.logs import Trajectory


def tracks(seed, n=120):
    """A drive with turns beyond ±π, and an estimate of it."""
    rng = np.random.default_rng(seed)
    reference = np.cumsum(rng.normal(0.1, 0.5, (n, 3)), axis=0)
    return reference + rng.normal(0, 0.3, (n, 3)), reference


@pytest.mark.parametrize("part", ["translation", "rotation"])
def test_errors_are_those_of_evo(tmp_path, part):
    pytest.importorskip("evo")
    from evo.core.metrics import APE, RPE, PoseRelation
    from evo.tools.file_interface import read_tum_trajectory_file

    estimate, reference = tracks(0)
    times = 1e9 + 0.1 * np.arange(len(estimate))
    read = []
    for name, poses in (("reference", reference), ("estimate", estimate)):
        Trajectory(times, poses).write(tmp_path / name)
        read.append(read_tum_trajectory_file(str(tmp_path / name)))
    relation = {"translation": "translation_part", "rotation": "rotation_angle_rad"}[part]
    for metric, ours in ((APE, absolute), (RPE, relative_errors)):
        theirs = metric(pose_relation=PoseRelation[relation])
        theirs.process_data(tuple(read))
        found = getattr(ours(estimate, reference), part)
        np.testing.assert_allclose(found, theirs.error, rtol=0, atol=1e-6)


def test_poses_without_a_reference_count_for_nothing():
    estimate, reference = tracks(0)
    reference[::3] = np.nan
    known = np.isfinite(reference[:, 0])
    whole = absolute(estimate, reference)
    assert whole.rmse == absolute(estimate[known], reference[known]).rmse
    assert whole.translation.size == known.sum()
