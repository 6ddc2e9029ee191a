"""Output files: whole or not there, in a folder that can be written to."""

import errno
import os
import tempfile
from pathlib import Path

import pytest

from deqmcl_gym.files import writable_folder, write_text
from deqmcl_gym.validation import InputError


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


def test_a_write_becomes_visible_only_when_it_is_whole(tmp_path, monkeypatch):
    target = tmp_path / "table.csv"
    write_text(target, "old\n")
    really, seen = os.replace, []

    def look(source, destination):
        seen.append((target.read_text(), Path(source).read_text(), Path(source).parent))
        really(source, destination)

    monkeypatch.setattr(os, "replace", look)
    write_text(target, "new\n")
    assert seen == [("old\n", "new\n", tmp_path)]
    assert target.read_text() == "new\n"


@pytest.mark.parametrize("kind", [errno.EACCES, errno.EROFS, errno.ENOSPC])
def test_a_folder_in_which_no_file_can_be_made_is_refused_with_the_reason(
    tmp_path, monkeypatch, kind
):
    def fail(**_):
        raise OSError(kind, os.strerror(kind))

    monkeypatch.setattr(tempfile, "TemporaryFile", fail)
    with pytest.raises(InputError, match=os.strerror(kind)) as caught:
        writable_folder(tmp_path)
    assert str(tmp_path) in str(caught.value)
