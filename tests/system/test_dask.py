"""A sweep on a real Dask cluster of two worker processes, one of which is killed."""

import os
import sys
from pathlib import Path

import pytest
from deqmcl_command import process, records
from sweep_command import tables, write_small

pytest.importorskip("distributed")

TROUBLED = Path(__file__).with_name("troubled.py")


def run(file, out, *more, flag):
    command = (sys.executable, TROUBLED, "sweep", file, "--out", out, "--with", "die-once")
    return process(*command, *more, env=os.environ | {"TROUBLED_FLAG": str(flag)})


@pytest.mark.slow  # every process of the cluster loads all anew
def test_a_cluster_that_loses_a_worker_gives_the_numbers_of_one_process(tmp_path):
    file, flag = write_small(tmp_path, trials=3), tmp_path / "flag"
    here = run(file, tmp_path / "here", "--jobs", "1", flag=flag)
    assert here.returncode == 0, here.stderr
    from distributed import LocalCluster

    flag.touch()
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        there = run(file, tmp_path / "there", "--jobs", "2", "--dask", address, flag=flag)
    assert there.returncode == 0, there.stderr
    assert not flag.exists()  # a worker found it and died
    assert there.stdout.startswith("small: 9 of 9 trials finished.")
    assert tables(tmp_path / "there") == tables(tmp_path / "here")
    assert records(tmp_path / "there") == records(tmp_path / "here")


def test_a_scheduler_that_does_not_answer_is_bad_input(tmp_path, refusal, monkeypatch):
    from benchmarks.execution import engines

    monkeypatch.setattr(engines, "CONNECT_SECONDS", 1)
    given = ("--out", tmp_path / "out", "--dask", "tcp://127.0.0.1:9")
    said = "deqmcl: the Dask scheduler 'tcp://127.0.0.1:9' cannot be reached"
    refusal(["sweep", write_small(tmp_path, trials=1), *given], said)
    assert not (tmp_path / "out").exists()
