"""One file per finished trial: whole or not there."""

import json

import msgspec
import pytest
from deqmcl_command import files
from report_cases import changed, finished

from benchmarks.sweeps import store as store_module
from benchmarks.sweeps.store import SCHEMA, Store, _checksum, named
from benchmarks.trials.scoring import Record
from benchmarks.trials.spec import Trial

TRIAL = Trial(scenario="paper", localizer="mcl", params=(), lag=20, seed=0, trial=0)
KEY = "0123abcd"
HUGE = 10**400
FILES = [f"timings/{KEY}.json", f"trials/{KEY}.json"]


def record_of(done):
    """What a store is given of a finished trial."""
    parts = msgspec.structs.asdict(done)
    return Record(**{name: parts[name] for name in Record.__struct_fields__})


DONE = changed(finished("mcl", 0, 1.5), trial=TRIAL, key=KEY, seconds=2.5)
RECORD = record_of(DONE)


def stored(tmp_path):
    """The store, and the file of a finished trial in it."""
    store = Store(tmp_path)
    store.put(KEY, TRIAL, RECORD, 2.5)
    return store, tmp_path / "trials" / f"{KEY}.json"


def test_what_is_put_is_got_with_its_time_and_nothing_else_is_written(tmp_path):
    store, _ = stored(tmp_path / "new" / "folder")
    found = store.get(KEY, TRIAL)
    assert found == DONE
    assert [*files(store.out)] == FILES
    assert Store(store.out).get(KEY, TRIAL) == found
    assert store.get("another", TRIAL) is None


def test_the_file_of_a_trial_does_not_depend_on_its_time(tmp_path):
    store, path = stored(tmp_path)
    before = path.read_bytes()
    store.put(KEY, TRIAL, RECORD, 99.0)
    assert path.read_bytes() == before


@pytest.mark.parametrize("content", [None, b"", b'{"seconds": 3}'])
def test_a_trial_without_its_time_is_still_finished(tmp_path, content):
    store, _ = stored(tmp_path)
    path = tmp_path / "timings" / f"{KEY}.json"
    path.unlink() if content is None else path.write_bytes(content)
    assert store.get(KEY, TRIAL) == changed(DONE, seconds=None)
    assert list(store.rejected) == ([] if content is None else [f"timings/{KEY}.json"])


def damaged(good):
    """Contents that are no finished trial of this key: what is said of them, and the bytes."""
    value = json.loads(good)

    def changed(**parts):
        return json.dumps(value | parts).encode()

    def forged(**parts):
        content = {name: part for name, part in (value | parts).items() if name != "checksum"}
        return json.dumps(content | {"checksum": _checksum(content)}).encode()

    return {
        "empty": ("is truncated", b""),
        "not text": ("cannot be read", b"\xff\xfe\x00" + good),
        "not JSON": ("is truncated, or not JSON", b"error,entropy\n1,2\n"),
        "nested": ("is nested too deeply", b"[" * 100_000),
        "of another schema": (f"has schema 1, not {SCHEMA}", changed(schema=1)),
        "of another trial": ("of another trial", changed(key="ffff")),
        "edited by hand": ("checksum does not match", good.replace(b"1.5", b"1.4")),
        "with a NaN": ("contains NaN", good.replace(b"1.5", b"NaN")),
        "with a number too large": ("is infinite", good.replace(b"1.5", b"1e999")),
        "forged without scores": ("null instead of array at scores, as no", forged(scores=None)),
        "forged with words for numbers": ("str instead of float | null at curves[].error", forged(
            curves={"0": {"first_state": 0, "error": ["a"]}})),
        **{
            f"forged with {part} out of range": ("value out of range", forged(**{part: value}))
            for part, value in {
                "steps_done": HUGE,
                "events": {"blind_scans": -1},
                "curves": {"0": {"first_state": HUGE, "error": [1.5]}},
                "profile": {"0": 1e308},
                "journey": {"scores": {}, "curves": {"way": [HUGE]}},
            }.items()
        },
        "forged with a unit": ("value out of range at unit", forged(unit="\x1b[31m")),
        "forged with a share": ("share of lost", forged(scores=[value["scores"][0] | {"lost": 7}])),
        "forged without offset 0": ("or none at offset 0", forged(
            scores=[value["scores"][0] | {"offset": 7}], curves={"7": value["curves"]["0"]})),
        "forged as another trial": ("of another trial", forged(trial={"trial": 7})),
    }  # fmt: skip


@pytest.mark.parametrize("kind", damaged(b'{"scores": [{}], "curves": {"0": {}}}'))
def test_a_damaged_trial_is_named_counts_as_missing_and_is_replaced_by_the_next_run(tmp_path, kind):
    store, path = stored(tmp_path)
    good = path.read_bytes()
    why, content = damaged(good)[kind]
    assert content != good
    path.write_bytes(content)
    assert store.get(KEY, TRIAL) is None
    assert list(store.rejected) == [f"trials/{KEY}.json"]
    assert why in store.rejected[f"trials/{KEY}.json"]
    store.put(KEY, TRIAL, RECORD, 2.5)
    assert path.read_bytes() == good


@pytest.mark.parametrize(
    "part", [{"unit": 3}, {"events": {"skipped_beams": True}}, {"scans_used": float("nan")}]
)
def test_what_would_not_be_believed_is_not_kept(tmp_path, part):
    store = Store(tmp_path)
    with pytest.raises(ValueError, match=next(iter(part))):
        store.put(KEY, TRIAL, changed(RECORD, **part), 1.0)
    assert not (tmp_path / "trials").exists()


def test_a_trial_that_the_disk_does_not_give_is_named(tmp_path):
    store, path = stored(tmp_path)
    path.unlink()
    path.symlink_to("/proc/self/mem")  # opens, and fails when it is read
    assert store.get(KEY, TRIAL) is None
    assert store.rejected[f"trials/{KEY}.json"].startswith("cannot be read (")


def test_the_order_of_keys_and_the_spaces_of_a_file_are_no_change(tmp_path):
    store, path = stored(tmp_path)
    value = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(value.items())), indent=4))
    assert store.get(KEY, TRIAL) == DONE


def test_a_failure_is_kept_until_the_trial_succeeds(tmp_path):
    store = Store(tmp_path)
    assert store.failure(KEY, TRIAL) is None
    store.put_failure(KEY, TRIAL, "it slept")
    assert Store(tmp_path).failure(KEY, TRIAL) == "it slept"
    assert store.get(KEY, TRIAL) is None
    store.put(KEY, TRIAL, RECORD, 1.0)
    assert store.failure(KEY, TRIAL) is None
    assert [*files(tmp_path)] == FILES


def test_files_that_are_no_trial_of_the_sweep_are_named_with_the_reason(tmp_path):
    store, path = stored(tmp_path)
    other = Trial(scenario="paper", localizer="ekf", params=(), lag=20, seed=0, trial=0)
    store.put_failure("0ld", TRIAL, "it slept")
    store.put_failure("e1f", other, "it slept")
    for name in (".deqmcl-0123abcd.tmp", "notes.txt", "a\x1b[31m\nb"):
        (path.parent / name).write_text("mine")
    (path.parent / "ffff.json").write_bytes(path.read_bytes())
    (path.parent / "folder.json").mkdir()
    assert dict(store.left_out({KEY}, {named(TRIAL.canonical())})) == {
        "trials/ffff.json": "is of another trial",
        "trials/folder.json": "is a folder",
        "trials/notes.txt": "is no file of a trial",
        "trials/a\\x1b[31m b": "is no file of a trial",
        "failed/0ld.json": "is of other code, libraries or plug-ins",
        "failed/e1f.json": "is of a trial that this sweep does not have",
    }
    assert store.temporary() == [path.parent / ".deqmcl-0123abcd.tmp"]


def test_a_trial_is_written_after_its_time(tmp_path, monkeypatch):
    written, really = [], store_module.write_text

    def note(path, text, **how):
        written.append(path.parent.name)
        really(path, text, **how)

    monkeypatch.setattr(store_module, "write_text", note)
    stored(tmp_path)
    assert written == ["timings", "trials"]
