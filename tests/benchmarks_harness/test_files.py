"""The folder that a command writes to; files that are whole or not there."""

import errno
import os
import tempfile

import pytest
from deqmcl_command import files
from refusals import refused

from benchmarks.files import own_folder, write_files
from deqmcl_gym.files import writable_folder, write_text

FILES = {"a.csv": b"a", "images/b.svg": b"b"}


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


def test_a_folder_of_others_or_of_a_sweep_is_refused(tmp_path):
    write_files(tmp_path / "mine", {".notes.tmp": b"x"})
    write_files(tmp_path / "report", FILES)
    write_files(tmp_path / "sweep", FILES | {"manifest.json": b"{}"})
    for name, file in (("mine", "a.csv"), ("report", "lap.webp"), ("sweep", "a.csv")):
        with refused("holds files, but none of this command's"):
            own_folder(tmp_path / name, file)
    assert own_folder(tmp_path / "report", "a.csv").is_dir()
    for name in ("trials.jsonl", ".deqmcl-a1b2c3d4.tmp"):  # of a process that was killed
        (killed := tmp_path / f"killed {name}").mkdir()
        (killed / name).touch()
        assert own_folder(killed, "a.csv").is_dir()


@pytest.mark.parametrize("broken", ["fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
def test_a_write_that_fails_leaves_the_old_file_and_nothing_beside_it(
    tmp_path, monkeypatch, broken, error
):
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
def test_a_folder_in_which_no_file_can_be_made_is_refused_with_the_reason(
    tmp_path, monkeypatch, kind
):
    def fail(**_):
        raise OSError(kind, os.strerror(kind))

    monkeypatch.setattr(tempfile, "TemporaryFile", fail)
    with refused(os.strerror(kind), str(tmp_path)):
        writable_folder(tmp_path)
