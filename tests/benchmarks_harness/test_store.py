"""Files are whole or not there; trials are lines, read again whatever is torn."""

import errno
import json
import os
import shutil
import subprocess
import sys
import tempfile

import pytest
from deqmcl_command import files
from refusals import refused
from report_cases import changed, finished

from benchmarks.sweeps.store import Store, named, own_folder, write_files, writing
from benchmarks.trials import Trial
from benchmarks.trials.scoring import TrialRecord
from deqmcl_gym.files import writable_folder, write_text

TRIAL = Trial(scenario="paper", localizer="mcl", params=(), lag=20, seed=0, trial=0)
KEY = "0123abcd"
DONE = changed(finished("mcl", 0, 1.5), trial=TRIAL, key=KEY, seconds=2.5)
FILES = {"a.csv": b"a", "images/b.svg": b"b"}


def record_of(done):
    return TrialRecord(**{name: getattr(done, name) for name in TrialRecord.__struct_fields__})


RECORD = record_of(DONE)


def stored(out, *keys, shard=None):
    with writing(out, shard) as store:
        for key in keys or (KEY,):
            store.put(key, TRIAL, RECORD, 2.5)
    return (out / "trials.jsonl").read_text().splitlines() if shard is None else []


def test_what_is_put_is_got_and_nothing_else_is_written(tmp_path):
    with writing(tmp_path / "new" / "folder") as store:
        store.put(KEY, TRIAL, RECORD, 2.5)
        assert store.get(KEY, TRIAL) == DONE
        assert Store(store.out).get(KEY, TRIAL) == DONE
    assert [*files(store.out)] == ["trials.jsonl"]
    assert store.get("another", TRIAL) is None
    (line,) = (store.out / "trials.jsonl").read_text().splitlines()
    assert json.loads(line).keys() == {"key", "trial", "record", "seconds", "crc"}


def test_a_failure_is_kept_until_the_trial_succeeds_whatever_is_read_last(tmp_path):
    with writing(tmp_path, (1, 2)) as store:
        assert store.failure(KEY) is None
        store.put_failure(KEY, TRIAL, "it slept")
        assert store.failure(KEY) == Store(tmp_path).failure(KEY) == "it slept"
        store.put(KEY, TRIAL, RECORD, 2.5)
        assert store.failure(KEY) is None
    with writing(tmp_path) as store:
        store.put_failure(KEY, TRIAL, "it slept")
    assert Store(tmp_path).get(KEY, TRIAL) == DONE


def test_the_last_record_of_a_key_counts(tmp_path):
    stored(tmp_path)
    with writing(tmp_path) as store:
        store.put(KEY, TRIAL, changed(RECORD, scans_used=1), 2.5)
    assert Store(tmp_path).get(KEY, TRIAL).scans_used == 1


@pytest.mark.parametrize("cut", [0, 1, 40, -2, -1])
def test_a_torn_last_line_is_no_trial_and_the_next_one_is(tmp_path, cut):
    stored(tmp_path, "a", "b")
    path = tmp_path / "trials.jsonl"
    first, second = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + second[:cut])
    lost = cut != -1  # without the end of its line it is whole
    store = Store(tmp_path)
    assert (store.get("b", TRIAL) is None, store.rejected) == (lost, {})
    stored(tmp_path, "c")
    store = Store(tmp_path)
    assert [store.get(key, TRIAL) is None for key in "abc"] == [False, lost, False]
    assert store.rejected == {}


DAMAGED = {
    "is truncated, or not JSON": b"error,entropy",
    "cannot be read (it is not UTF-8)": b'"\xff"',
    "neither a record nor a reason": b'{"key": "x", "trial": {}}',
    "expected array, got null at record.scores": None,
    "is not as it was written": b'{"key":"x","trial":{},"reason":"it slept","crc":1}',
}


@pytest.mark.parametrize("why", DAMAGED)
def test_a_line_that_is_no_trial_is_named_and_the_others_count(tmp_path, why):
    (line,) = stored(tmp_path)
    made = json.loads(line)
    del made["crc"]
    wrong = json.dumps(made | {"record": made["record"] | {"scores": None}}).encode()
    with (tmp_path / "trials.jsonl").open("ab") as file:
        file.write((DAMAGED[why] or wrong) + b"\n\xff\n")
    store = Store(tmp_path)
    assert [*store.rejected] == ["trials.jsonl, line 2", "trials.jsonl, line 3"]
    assert why in store.rejected["trials.jsonl, line 2"]
    assert store.get(KEY, TRIAL) == DONE


@pytest.mark.parametrize(
    "part", [{"unit": 3}, {"events": {"skipped_beams": True}}, {"scans_used": float("nan")}]
)
def test_what_would_not_be_believed_is_not_kept(tmp_path, part):
    with writing(tmp_path) as store:
        with pytest.raises(ValueError, match=rf"{next(iter(part))}|not JSON compliant"):
            store.put(KEY, TRIAL, changed(RECORD, **part), 1.0)
        assert store.get(KEY, TRIAL) is None
    assert files(tmp_path) == {"trials.jsonl": b""}


def test_shards_are_joined_by_copying_or_by_cat(tmp_path):
    for part in (1, 2):
        stored(tmp_path / str(part), f"{part}", shard=(part, 2))
    shutil.copytree(tmp_path / "1", tmp_path / "2", dirs_exist_ok=True)
    assert all(Store(tmp_path / "2").get(key, TRIAL) for key in "12")
    content = files(tmp_path / "2")
    assert [*content] == ["trials-1-of-2.jsonl", "trials-2-of-2.jsonl"]
    (tmp_path / "cat").mkdir()
    (tmp_path / "cat" / "trials.jsonl").write_bytes(b"".join(content.values()))
    assert all(Store(tmp_path / "cat").get(key, TRIAL) for key in "12")


HOLDER = """
import sys, time
from pathlib import Path
from benchmarks.sweeps.store import writing
with writing(Path(sys.argv[1])):
    print("locked", flush=True)
    time.sleep(1000)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks there")
def test_one_writes_at_a_time_another_shard_may_and_the_lock_of_the_dead_is_none(tmp_path):
    command = [sys.executable, "-c", HOLDER, tmp_path]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "locked\n"
        with refused("another sweep is writing to", str(tmp_path)), writing(tmp_path):
            pass
        with writing(tmp_path, (1, 2)), writing(tmp_path, (2, 2)):
            pass
        holder.kill()
    stored(tmp_path)


def test_lines_that_are_no_trial_of_the_sweep_are_named_with_the_reason(tmp_path):
    other = Trial(scenario="paper", localizer="ekf", params=(), lag=20, seed=0, trial=0)
    stored(tmp_path)
    with writing(tmp_path) as store:
        store.put_failure("0ld", TRIAL, "it slept")
        store.put_failure("e1f", other, "it slept")
    left_out = Store(tmp_path).left_out({KEY}, {named(TRIAL.canonical())})
    assert dict(left_out) == {
        "trials.jsonl, line 2": "is of other code, libraries or plug-ins",
        "trials.jsonl, line 3": "is of a trial that this sweep does not have",
    }


def test_files_are_written_over_those_of_before_beside_the_users(tmp_path):
    write_files(tmp_path, FILES)
    (tmp_path / "notes.txt").write_bytes(b"mine")
    (tmp_path / "images" / ".deqmcl-a1b2c3d4.tmp").touch()  # of a process that was killed
    paths = write_files(tmp_path, {"images/b.svg": b"new"})
    assert paths == [tmp_path / "images" / "b.svg"]
    assert files(tmp_path) == FILES | {"images/b.svg": b"new", "notes.txt": b"mine"}


@pytest.mark.skipif(os.name == "nt", reason="no such permissions there")
@pytest.mark.parametrize("mask", [0o077, 0o022, 0o002])
def test_files_have_the_permissions_of_the_umask(tmp_path, mask):
    before = os.umask(mask)
    try:
        write_text(tmp_path / "new", "")
    finally:
        os.umask(before)
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o666 & ~mask


@pytest.mark.parametrize("name", ["trials.jsonl", ".deqmcl-a1b2c3d4.tmp"])
def test_a_folder_of_a_process_that_was_killed_is_ours(tmp_path, name):
    (tmp_path / name).touch()
    assert own_folder(tmp_path, "a.csv").is_dir()


@pytest.mark.parametrize("broken", ["fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
def test_a_write_that_fails_leaves_the_old_file_alone(tmp_path, monkeypatch, broken, error):
    target = tmp_path / "table.csv"
    write_text(target, "old\n")

    def fail(*_):
        raise error

    monkeypatch.setattr(os, broken, fail)
    with pytest.raises(type(error)) as caught:
        write_text(target, "new\n")
    # which file, for the reader of the message
    assert isinstance(error, KeyboardInterrupt) or caught.value.filename == str(target)
    assert sorted(os.listdir(tmp_path)) == ["table.csv"]
    assert target.read_text() == "old\n"


@pytest.mark.parametrize("kind", [errno.EACCES, errno.EROFS, errno.ENOSPC])
def test_a_folder_in_which_no_file_can_be_made_is_refused(tmp_path, monkeypatch, kind):
    def fail(**_):
        raise OSError(kind, os.strerror(kind))

    monkeypatch.setattr(tempfile, "TemporaryFile", fail)
    with refused(os.strerror(kind), str(tmp_path)):
        writable_folder(tmp_path)
