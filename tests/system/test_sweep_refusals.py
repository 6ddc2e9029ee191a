"""``deqmcl sweep`` before it runs: what it would do, and what it refuses."""

import re
import sys

import pytest
from sweep_command import sweep, write_small

from benchmarks.sweeps import dry_run


def test_a_dry_run_shows_the_cells_and_a_time_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    file = write_small(tmp_path, trials=50, more="\n[[vary]]\nscenario = ['paper', 'sharp']\n")
    assert sweep(file, tmp_path / "out", "--dry-run") == 0
    said = capsys.readouterr().out
    assert "small: 200 trials in 4 cells" in said
    assert re.search(r"sharp L=4 mcl particles=15 +50 +\d", said)
    assert re.search(r"About \d+ (s|min) with 1 job: estimated from one measured trial", said)
    assert [path.name for path in tmp_path.iterdir()] == ["small.toml"]


def test_a_dry_run_scales_the_time_of_the_limit_by_its_particles(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(dry_run, "BUDGET", 0.0)
    more = '\n[limit]\nname = "mcl"\ntrials = 1\nfilter_seeds = 3\n[limit.params]\n'
    file = write_small(tmp_path, trials=50, more=f"{more}particles = 1_500_000\n")
    assert sweep(file, tmp_path / "out", "--dry-run") == 0
    said = capsys.readouterr().out
    assert "small: 103 trials in 3 cells" in said
    one = float(re.search(r"mcl particles=15 +50 +([\d.]+) s", said)[1])
    many = float(re.search(r"mcl particles=1500000 +3 +≈ ([\d.]+) s", said)[1])
    assert many == pytest.approx(1e5 * one, abs=0.006e5)  # it is shown to 0.01 s


@pytest.mark.parametrize(
    ("where", "time"),  # 100 trials of 6 s
    [
        (("--jobs", "1"), "10 min"),
        (("--jobs", "2"), "5 min"),
        (("--jobs", "1", "--shard", "2/5"), "2 min"),
        (("--jobs", "2", "--shard", "2/5"), "60 s"),
    ],
)
def test_the_time_of_a_dry_run_is_shared_out_among_jobs_and_shards(
    tmp_path, monkeypatch, capsys, where, time
):
    monkeypatch.setattr(dry_run, "_times", lambda trials, *_: [(6.0, True)] * len(trials))
    assert sweep(write_small(tmp_path, trials=50), tmp_path / "out", "--dry-run", *where) == 0
    assert f"About {time} with {where[1]} job" in capsys.readouterr().out


def points(*counts):
    """Axes with so many values each."""
    return "".join(
        f"\n[[vary]]\nworld.noise.{name} = {list(range(count))}"
        for name, count in zip(("drive", "turn", "drift"), counts, strict=False)
    )


BAD = [  # what is added to the file, arguments, and what the sentence must name
    ("\ntrails = 3", (), ["small.toml", "'trails'"]),
    (f"\nx = {'[' * 10**5}", (), ["small.toml", "nested too deeply"]),
    ('\nbeta = "a\\u0007b"', (), ["beta", "control characters"]),
    ("", ("--with", "=x.py:L"), ["'=x.py:L'", "./=x.py:L"]),
    ("", ("--with", "a\nb.py:L"), [r"'a\nb.py:L'", "rename its file"]),
    ("", ("--with", "a\udce9.py:L"), [r"'a\udce9.py:L'", "no UTF-8"]),
    ("\nbeta = 3", (), ["'beta'", "particles"]),  # in [params]
    ("\n[world]\nlidar.beans = 3", (), ["'beans'", "did you mean 'beams'?"]),
    ("\n[[vary]]\nparams.particles = [5, 1.5]", (), ["particles", "1.5"]),
    ("\n[[vary]]\nparams.particles = [1000000000]", (), ["particles", "1,000,000,000", "GiB"]),
    (points(125, 100, 200), ("--yes",), ["10,000,000", "more than 1,000,000"]),
    (points(125, 1000), (), ["500,000", "--yes"]),
    ("", ("--timeout", "nan"), ["--timeout", "nan"]),
    ("", ("--shard", "4/3"), ["--shard", "'4/3'"]),
    ("", ("--shard", "half"), ["--shard", "'half'"]),
    ("", ("--executor", "threads"), ["'threads'", "dask", "module:factory"]),
    ("", ("--executor", "no_such:thing"), ["'no_such:thing'", "ModuleNotFoundError"]),
    ("", ("--executor", "os:nothing"), ["'os:nothing'", "AttributeError"]),
    ("", ("--executor", "os:sep"), ["'os:sep'", "function"]),
    ("", ("--executor", "os:getcwd"), ["'os:getcwd'", "type str"]),
    ("", ("--scheduler", "tcp://x:1"), ["--scheduler", "--executor dask"]),
]


@pytest.mark.parametrize(
    ("more", "arguments", "named"), BAD, ids=[(case[0][:50] or str(case[1])) for case in BAD]
)
def test_what_cannot_be_run_is_refused_in_one_sentence_before_anything_is_written(
    tmp_path, monkeypatch, capsys, more, arguments, named
):
    monkeypatch.chdir(tmp_path)
    text = write_small(tmp_path).read_text()
    (tmp_path / "small.toml").write_text(text + more)
    assert sweep("small.toml", "out", *arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("deqmcl: ")
    assert said.err.count("\n") == 1
    for words in named:
        assert words in said.err
    assert [path.name for path in tmp_path.iterdir()] == ["small.toml"]


def test_dask_that_is_not_installed_is_said_with_the_pip_command(
    file, tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert sweep(file, tmp_path / "out", "--executor", "dask") == 2
    assert "pip install 'deqmcl-gym[dask]'" in capsys.readouterr().err
