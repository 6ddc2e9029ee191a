"""``deqmcl sweep`` when trials fail, a plug-in leaves, or the disk is full."""

import errno
import os

from deqmcl_command import exit_code, files, lines, records
from sweep_command import broken, sweep, tables, write_small

import localizers
from benchmarks.sweeps.store import Store


@localizers.registered("broken", broken)
def test_failed_trials_are_said_kept_and_run_again_only_if_asked(tmp_path, capsys, ran):
    file = write_small(tmp_path, others=("broken",))
    out = tmp_path / "out"
    for again in ((), (), ("--retry-failed",)):
        ran.clear()
        assert sweep(file, out, *again) == 3
        said = capsys.readouterr()
        assert said.out.startswith("small: 4 of 6 trials finished, 2 failed.\n")
        assert said.err == (
            "deqmcl: 2 of 6 trials failed, the rest is kept; first: broken, trial 0: "
            "ArithmeticError: broken (--debug shows where)\n"
        )
    assert [trial.localizer for trial in ran] == ["broken"] * 2
    assert {line["method"] for line in lines(out)} == {"mcl", "dead-reckoning"}


def test_a_disk_that_fills_up_is_said_in_one_line_and_the_sweep_goes_on_later(
    file, finished, tmp_path, monkeypatch, capsys
):
    really, out = Store._append, tmp_path / "out"

    def fill_up(store, *parts):
        if len(records(out)) == 2:
            store._file.write(b'{"key": "a')
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        really(store, *parts)

    with monkeypatch.context() as patch:
        patch.setattr(Store, "_append", fill_up)
        assert sweep(file, out) == 3
    assert capsys.readouterr().err.startswith("deqmcl: No space left on device")
    kept = records(out)
    assert len(kept) == 2
    assert sweep(file, out) == 0
    assert kept.items() <= records(out).items()
    assert tables(out) == tables(finished)


def test_what_keeps_the_pictures_away_does_not_keep_the_tables_away(tmp_path, monkeypatch):
    def undrawn(*_, **__):
        raise RuntimeError("no pictures today")

    monkeypatch.setattr("benchmarks.report.page.page_files", undrawn)
    file, out = write_small(tmp_path, trials=1), tmp_path / "out"
    assert exit_code("sweep", file, "--out", out, "--jobs", "1") == 3
    assert {"results.csv", "trials.csv"} < files(out).keys()
