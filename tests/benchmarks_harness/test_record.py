"""Files that are made again only if they have to be."""

import json

import pytest

from benchmarks.files import written


def writer(folder, content):
    """Writes these files and counts how often."""

    def write():
        write.calls += 1
        for name, words in content.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(words)
        return [folder / name for name in content]

    write.calls = 0
    return write


@pytest.fixture
def made(tmp_path):
    write = writer(tmp_path, {"a.csv": "a", "images/b.svg": "b"})
    written(tmp_path / "written.json", "source", write)
    return write


def again(tmp_path, write, source="source"):
    """How often files are written at a second call, and which there are then."""
    before = write.calls
    names = [
        str(path.relative_to(tmp_path))
        for path in written(tmp_path / "written.json", source, write)
    ]
    return write.calls - before, names


def test_files_that_are_there_are_not_written_again_and_are_listed(tmp_path, made):
    assert again(tmp_path, made) == (0, ["a.csv", "images/b.svg"])


def test_files_of_another_source_are_written_again(tmp_path, made):
    assert again(tmp_path, made, "another") == (1, ["a.csv", "images/b.svg"])
    assert again(tmp_path, made, "another")[0] == 0


@pytest.mark.parametrize("spoil", [lambda p: p.unlink(), lambda p: p.write_text("other")])
def test_a_file_that_is_gone_or_was_changed_is_written_again(tmp_path, made, spoil):
    spoil(tmp_path / "images" / "b.svg")
    assert again(tmp_path, made)[0] == 1
    assert (tmp_path / "images" / "b.svg").read_text() == "b"


def test_files_that_are_no_longer_made_are_removed(tmp_path, made):
    fewer = writer(tmp_path, {"a.csv": "a"})
    assert again(tmp_path, fewer, "another") == (1, ["a.csv"])
    assert not (tmp_path / "images" / "b.svg").exists()


@pytest.mark.parametrize("words", ["", "[]", "{}", '{"source": "source", "files": 3}', "\x00"])
def test_a_spoilt_record_counts_as_none(tmp_path, made, words):
    (tmp_path / "written.json").write_text(words)
    assert again(tmp_path, made)[0] == 1


@pytest.mark.parametrize("name", ["../precious", "/tmp/../tmp/precious", "images/../../precious"])
def test_a_record_cannot_name_files_outside_its_folder(tmp_path, name):
    precious = tmp_path / "precious"
    precious.write_text("kept")
    (tmp_path / "out").mkdir()
    record = {"source": "", "files": {name: ""}}
    (tmp_path / "out" / "written.json").write_text(json.dumps(record))
    written(tmp_path / "out" / "written.json", "source", lambda: [])
    assert precious.read_text() == "kept"
