"""The lock where there is no flock and no open file can be removed, as on Windows."""

from pathlib import Path

import pytest

from benchmarks.files import lock


@pytest.fixture(autouse=True)
def windows(monkeypatch):
    """Refuse to remove what is open; have no flock."""
    opened = []
    really_open, really_unlink = Path.open, Path.unlink

    def remember(path, *arguments):
        file = really_open(path, *arguments)
        opened.append((path, file))
        return file

    def unlink(path, missing_ok=False):
        if any(path == other and not file.closed for other, file in opened):
            raise PermissionError(13, "The process cannot access the file", str(path))
        really_unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(lock, "fcntl", None)
    monkeypatch.setattr(Path, "open", remember)
    monkeypatch.setattr(Path, "unlink", unlink)


@pytest.mark.parametrize("shard", [None, "1/2"])
def test_no_lock_stays_where_open_files_cannot_be_removed(tmp_path, shard):
    with lock.locked(tmp_path, shard):
        assert (tmp_path / ".deqmcl.lock").exists()
    assert list(tmp_path.iterdir()) == []


def test_the_last_of_two_shards_removes_the_lock_that_they_share(tmp_path):
    with lock.locked(tmp_path, "1/2"):
        with lock.locked(tmp_path, "2/2"):
            pass
        assert (tmp_path / ".deqmcl.lock").exists()
    assert list(tmp_path.iterdir()) == []
