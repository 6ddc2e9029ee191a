"""APE and RPE are evo's, as its command line computes them from our TUM files."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from benchmarks.trials.tracks import absolute, relative_errors
from deqmcl_gym.logs import Trajectory

BESIDE = Path(sys.executable).parent  # where pip puts commands
EVO = {name: shutil.which(name, path=BESIDE) for name in ("evo_ape", "evo_rpe")}
RELATIONS = {"trans_part": "translation", "angle_rad": "rotation"}


def tracks(seed, n=120):
    """A drive with turns beyond ±π, and an estimate of it."""
    rng = np.random.default_rng(seed)
    reference = np.cumsum(rng.normal(0.1, 0.5, (n, 3)), axis=0)
    return reference + rng.normal(0, 0.3, (n, 3)), reference


def by_evo(tool, folder, relation):
    """The error of each pose, as evo's command says."""
    saved = folder / f"{tool}-{relation}.zip"
    command = [EVO[tool], "tum", folder / "reference.tum", folder / "estimate.tum"]
    subprocess.run(
        [*command, "-r", relation, "--save_results", saved, "--no_warnings"],
        env=os.environ | {"HOME": str(folder)}, check=True, capture_output=True,
    )  # fmt: skip
    with zipfile.ZipFile(saved) as archive, archive.open("error_array.npy") as file:
        return np.load(file)


@pytest.mark.skipif(None in EVO.values(), reason="evo is not installed")
def test_errors_are_those_of_evo(tmp_path):
    estimate, reference = tracks(0)
    times = 1e9 + 0.1 * np.arange(len(estimate))
    Trajectory(times, estimate).write(tmp_path / "estimate.tum")
    Trajectory(times, reference).write(tmp_path / "reference.tum")
    found = {
        "evo_ape": absolute(estimate, reference),
        "evo_rpe": relative_errors(estimate, reference),
    }
    for tool, errors in found.items():
        for relation, part in RELATIONS.items():
            expected = by_evo(tool, tmp_path, relation)
            np.testing.assert_allclose(getattr(errors, part), expected, rtol=0, atol=1e-6)


def test_poses_without_a_reference_count_for_nothing():
    estimate, reference = tracks(0)
    reference[::3] = np.nan
    known = np.isfinite(reference[:, 0])
    whole = absolute(estimate, reference)
    assert whole.rmse == absolute(estimate[known], reference[known]).rmse
    assert whole.translation.size == known.sum()
