"""One file per finished trial: whole or not there."""

import json

import pytest

from benchmarks.sweeps import store as store_module
from benchmarks.sweeps.store import Store

RECORD = {"scores": [{"offset": 0, "error": 1.5, "entropy": None}], "steps_done": 3}
KEY = "0123abcd"


def files(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def stored(tmp_path):
    """The store, and the file of a finished trial in it."""
    store = Store(tmp_path)
    store.put(KEY, RECORD, 2.5)
    return store, tmp_path / "trials" / f"{KEY}.json"


def test_what_is_put_is_got_with_its_time_and_nothing_else_is_written(tmp_path):
    store, _ = stored(tmp_path / "new" / "folder")
    found = store.get(KEY)
    assert found == RECORD | {"seconds": 2.5}
    assert files(store.out) == [f"timings/{KEY}.json", f"trials/{KEY}.json"]
    assert Store(store.out).get(KEY) == found
    assert store.get("another") is None


def test_the_file_of_a_trial_does_not_depend_on_its_time(tmp_path):
    store, path = stored(tmp_path)
    before = path.read_bytes()
    store.put(KEY, RECORD, 99.0)
    assert path.read_bytes() == before


def test_a_trial_without_its_time_is_still_finished(tmp_path):
    store, _ = stored(tmp_path)
    (tmp_path / "timings" / f"{KEY}.json").unlink()
    assert store.get(KEY) == RECORD | {"seconds": None}


def damaged(good):
    """Contents that are no finished trial of this key: what is said of them, and the bytes."""
    value = json.loads(good)

    def changed(**parts):
        return json.dumps(value | parts).encode()

    return {
        "empty": ("is torn", b""),
        "not text": ("cannot be read", b"\xff\xfe\x00" + good),
        "not JSON": ("is torn or not JSON", b"error,entropy\n1,2\n"),
        "of another schema": ("has schema 1, not 3", changed(schema=1)),
        "of another trial": ("belongs to another trial", changed(key="ffff")),
        "edited by hand": ("checksum does not match", good.replace(b"1.5", b"1.4")),
        "with a NaN": ("holds NaN", good.replace(b"1.5", b"NaN")),
        "with a number too large": ("is infinite", good.replace(b"1.5", b"1e999")),
    }


@pytest.mark.parametrize("kind", damaged(b'{"schema": 3, "key": "0123abcd"}'))
def test_a_damaged_trial_is_named_counts_as_missing_and_is_replaced_by_the_next_run(tmp_path, kind):
    store, path = stored(tmp_path)
    good = path.read_bytes()
    why, content = damaged(good)[kind]
    assert content != good
    path.write_bytes(content)
    assert store.get(KEY) is None
    assert list(store.rejected) == [f"trials/{KEY}.json"]
    assert why in store.rejected[f"trials/{KEY}.json"]
    store.put(KEY, RECORD, 2.5)
    assert path.read_bytes() == good


def test_the_order_of_keys_and_the_spaces_of_a_file_are_no_change(tmp_path):
    store, path = stored(tmp_path)
    value = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(value.items())), indent=4))
    assert store.get(KEY) == RECORD | {"seconds": 2.5}


def test_a_failure_is_kept_until_the_trial_succeeds(tmp_path):
    store = Store(tmp_path)
    assert store.failure(KEY) is None
    store.put_failure(KEY, {"trial": 0}, "it slept")
    assert Store(tmp_path).failure(KEY) == {"trial": {"trial": 0}, "reason": "it slept"}
    assert store.get(KEY) is None
    store.put(KEY, RECORD, 1.0)
    assert store.failure(KEY) is None
    assert files(tmp_path) == [f"timings/{KEY}.json", f"trials/{KEY}.json"]


def test_strays_are_files_that_are_no_trial_of_the_sweep(tmp_path):
    store, path = stored(tmp_path)
    (path.parent / f".{KEY}.json.x1.tmp").write_text("half")
    (path.parent / "ffff.json").write_bytes(path.read_bytes())
    (path.parent / "notes.txt").write_text("mine")
    (tmp_path / "timings" / f".{KEY}.json.x2.tmp").write_text("half")
    (tmp_path / ".results.csv.x3.tmp").write_text("half")
    assert store.strays({KEY}) == {
        ".results.csv.x3.tmp": "was left by an interrupted write",
        f"timings/.{KEY}.json.x2.tmp": "was left by an interrupted write",
        f"trials/.{KEY}.json.x1.tmp": "was left by an interrupted write",
        "trials/ffff.json": "is not a trial of this sweep",
        "trials/notes.txt": "is not a trial of this sweep",
    }


def test_a_trial_is_written_after_its_time(tmp_path, monkeypatch):
    written, really = [], store_module.write_text

    def note(path, text):
        written.append(path.parent.name)
        really(path, text)

    monkeypatch.setattr(store_module, "write_text", note)
    stored(tmp_path)
    assert written == ["timings", "trials"]
