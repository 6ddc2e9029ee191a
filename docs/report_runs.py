"""The runs behind ``docs/reports``: do they still have the same numbers, and one made again.

``docs/reports/made.toml`` has one line a report: its command, the commit whose code made it, its
files. Of most there is a sample, ``sampled/NAME.csv``: the first world of each setting and method
and 1 % of the others, with a digest of each record. ``python -m docs.report_runs`` runs all samples
again; a change of code that alters none of their records makes nothing stale. With names it runs
the commands of these reports, and writes their files and samples.
"""

import argparse
import csv
import hashlib
import json
import shlex
import subprocess
import sys
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from msgspec import Struct, convert, to_builtins
from msgspec.structs import replace

from benchmarks.commands.experiments import asked, paper_command, sweep_command
from benchmarks.execution.engines import Where
from benchmarks.sweeps import Sweep
from benchmarks.sweeps.results import results_in
from benchmarks.sweeps.running import compare_again, record_parts, sample
from benchmarks.sweeps.sweepfile import paper_sweep
from benchmarks.tables.comparison import FURTHER
from benchmarks.tables.frames import csv_of
from benchmarks.tables.panels import trial_words
from benchmarks.trials import Trial, code_digest
from benchmarks.trials.scoring import TrialRecord
from benchmarks.trials.stage import Outcome, provenance_of
from deqmcl_gym.files import write_text
from deqmcl_gym.validation import InputError

ROOT = Path(__file__).resolve().parents[1]
REPORTS = ROOT / "docs" / "reports"
RUNS = ROOT / "results" / "reports"
_HEAD = """\
# One line a report, see docs/report_runs.py. `verified` is the digest of the last code under which
# every sample has been seen to have the same records.
"""
_SAMPLED = ("trial", "scenario", "method", "world", "filter_seed", "error", "record")


class Report(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What is committed of one run."""

    command: str  # the words after ``deqmcl``, without --out; or, in words, how it is made by hand
    commit: str  # whose code made it; of an older one, the commit that brought its files
    files: dict[str, str]  # committed files, in docs/reports, by those of the run's folder
    minutes: float = 0.0  # on two cores; 0 where nobody knows
    note: str = ""  # why it has no sample, or what else a reader must know


class Made(Struct, frozen=True, forbid_unknown_fields=True):
    """``made.toml``."""

    verified: str
    reports: dict[str, Report]


def read() -> Made:
    """Return what is committed."""
    return convert(tomllib.loads((REPORTS / "made.toml").read_text(encoding="utf-8")), Made)


def write(made: Made) -> None:
    """Write ``made.toml``, a line a report."""
    lines = [f"{name} = {_toml(to_builtins(r))}\n" for name, r in made.reports.items()]
    text = f'{_HEAD}verified = "{made.verified}"\n\n[reports]\n{"".join(lines)}'
    write_text(REPORTS / "made.toml", text)


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; 1 if a report has other numbers than this code."""
    parser = argparse.ArgumentParser(prog="make reports", description="Verify or renew reports.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="run these again, whole")
    parser.add_argument("--check", action="store_true", help="write nothing")
    parser.add_argument("--jobs", type=int, metavar="J", help="trials at a time (one per CPU)")
    options = parser.parse_args(words)
    made, where = read(), Where(jobs=options.jobs)
    for name in options.names:
        if name not in made.reports:
            raise InputError(f"there is no report {name}; there are {', '.join(made.reports)}.")
        made = replace(made, reports=made.reports | {name: _renewed(name, made, where)})
        write(made)
    if options.names:
        return 0
    if made.verified == code_digest():
        print("Every sample has been verified under this code.")
        return 0
    differing = [name for name, report in made.reports.items() if _differs(name, report, where)]
    if differing:
        print(f"Make them again, or find out why: make reports ARGS='{' '.join(differing)}'.")
    elif not options.check:
        write(replace(made, verified=code_digest()))
    return int(bool(differing))


def sweep_of(command: str) -> Sweep | None:
    """Return the sweep of a command of deqmcl; None: it is made by hand."""
    parser = argparse.ArgumentParser()
    first, *rest = shlex.split(command)
    if first == "sweep":
        sweep_command.arguments(parser)
        return asked(parser.parse_args(rest))
    if first == "paper":
        paper_command.arguments(parser)
        options = parser.parse_args(rest)
        names = ("scenario", "trials", "seed", "lag", "particles")
        return paper_sweep(**{name: getattr(options, name) for name in names})
    return None


def _differs(name: str, report: Report, where: Where) -> bool:
    """Run a report's sample again, if it has one; print what came of it."""
    sweep = sweep_of(report.command)
    if sweep is None or not _sample(name).exists():
        return False
    with _sample(name).open(newline="", encoding="utf-8") as file:
        rows = {row["trial"]: row for row in csv.DictReader(file)}
    trials = {_digest_of(trial): trial for trial in sweep.distinct()}
    if rows.keys() - trials.keys():
        print(f"{name}: its sweep no longer has the trials of its sample.")
        return True

    def difference(trial: str, outcome: Outcome) -> str:
        if outcome.record is None:
            return f"fails: {outcome.reason}"
        if fingerprint(outcome.record) == rows[trial]["record"]:
            return ""
        return f"had error {rows[trial]['error']} and has {outcome.record.scores[0]['error']}"

    chosen = {trial: trials[trial] for trial in rows}
    differing = compare_again(chosen, provenance_of(sweep.cells()), where, difference)
    for trial in filter(differing.__contains__, rows):
        first = trials[trial]
        words = f"{' '.join(trial_words(first))}, world {first.trial}, {differing[trial]}"
        print(f"{name}: {len(differing)} of {len(rows)} trials differ; the first, {words}.")
        return True
    print(f"{name}: {len(rows)} trials, none differs.")
    return False


def _renewed(name: str, made: Made, where: Where) -> Report:
    """Run a report's command; if all its trials finish, write its files and its sample."""
    report = made.reports[name]
    if sweep_of(report.command) is None:
        raise InputError(f"{name} is made by hand: {report.command}.")
    folder, begun = RUNS / f"{name}-{code_digest()[:8]}", time.monotonic()
    words = ["--out", str(folder), *([] if where.jobs is None else ["--jobs", str(where.jobs)])]
    command = [sys.executable, "-m", "benchmarks", *shlex.split(report.command), *words]
    new = not folder.exists()
    if subprocess.run(command, cwd=ROOT, check=False).returncode:
        raise InputError(f"the command of {name} failed; the same command goes on.")
    minutes, results = round((time.monotonic() - begun) / 60, 1), results_in(folder)
    for target, source in report.files.items():
        text = (folder / source).read_text(encoding="utf-8")
        if source == "results.csv":  # with what depends on the machine: ms a step, over baseline's
            times = results.table[["ms_per_step", "cost"]].map("{:.4g}".format).replace("nan", "")
            text = csv_of(results.table.drop(columns=[*FURTHER]).join(times))
        write_text(REPORTS / target, text)
    records = {record.key: record for record in results.records}
    rows = []
    for key, trial in sample({k: r.trial for k, r in records.items()}, code_digest()).items():
        identity = (_digest_of(trial), trial.scenario, trial.localizer, *trial.run)
        rows.append([*identity, records[key].scores[0]["error"], fingerprint(records[key])])
    write_text(_sample(name), csv_of(pd.DataFrame(rows, columns=_SAMPLED)))
    git = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    commit = subprocess.run(git, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return replace(
        report, commit=commit.strip(), minutes=minutes if new else report.minutes, note=""
    )


def fingerprint(record: TrialRecord) -> str:
    """Return a digest of all that is in a record, times and absent parts left out."""
    parts = {name: part for name, part in record_parts(record).items() if part is not None}
    return _digest(to_builtins(parts, str_keys=True, enc_hook=float), 32, sort_keys=True)


def _digest_of(trial: Trial) -> str:
    return _digest(trial.canonical(), 16)


def _digest(value: object, digits: int, *, sort_keys: bool = False) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=sort_keys).encode()).hexdigest()[:digits]


def _sample(name: str) -> Path:
    return REPORTS / "sampled" / f"{name}.csv"


def _toml(value: object) -> str:
    """Return a value on one line; a text of JSON is one of TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_toml(key)} = {_toml(part)}' for key, part in value.items())} }}"
    return json.dumps(value, ensure_ascii=False)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"make reports: {error}")
    except KeyboardInterrupt:
        sys.exit("make reports: stopped; what is finished is kept, and the same command goes on.")
