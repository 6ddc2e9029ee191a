"""``make reports``: verify what is stale, or make it again, the cheapest first.

A report's sample, ``docs/reports/sampled/NAME.csv``, is what ``deqmcl verify`` would run again: the
first world of each setting and method, and 1 % of the others, drawn by the digest of the code that
made it. Of each trial it has a digest of its record. If all are the same under this code, the
report is verified; if not, or without a sample, its command is run. What that finished before it
was stopped is kept in results/reports, and not run again under the same code.
"""

import argparse
import csv
import datetime
import hashlib
import json
import math
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from msgspec import to_builtins
from msgspec.structs import replace

from benchmarks.commands.experiments import asked, paper_command, sweep_command
from benchmarks.execution.engines import Where, available_cpus
from benchmarks.sweeps import manifest, suites
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.results import Results, results_in
from benchmarks.sweeps.store import named
from benchmarks.sweeps.verifying import compare_again, record_parts, sample
from benchmarks.tables.comparison import FURTHER
from benchmarks.tables.frames import csv_of
from benchmarks.trials.attempt import Outcome, provenance_of
from benchmarks.trials.provenance import code_digest
from benchmarks.trials.scoring import TrialRecord
from benchmarks.trials.spec import Trial
from deqmcl_gym.files import write_text
from deqmcl_gym.validation import InputError
from docs.numbers import made, pages
from docs.numbers.made import Report, Verified
from docs.numbers.reading import ROOT, csv_text

FOLDERS = ROOT / "results" / "reports"
CORES = 2  # that minutes are told for
_SAMPLED = ("trial", "scenario", "method", "world", "filter_seed", "error", "record")


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; 1 if a report is stale at its end."""
    options = _options(words)
    reports = made.read()
    if unknown := [name for name in options.names if name not in reports]:
        print(f"There is no report {unknown[0]}; there are {', '.join(reports)}.")
        return 2
    stale = _stale(reports, options)
    if options.dry_run or not stale:
        return int(bool(stale))
    still = []
    for name in stale:
        renewed = _renewed(name, reports[name], Where(jobs=options.jobs), run=not options.verify)
        if renewed is None:
            still.append(name)
        else:
            made.write(made.read() | {name: renewed})
    pages.main()
    if still:
        print(f"Still stale: {', '.join(still)}.")
    return int(bool(still))


def _stale(reports: Mapping[str, Report], options: argparse.Namespace) -> list[str]:
    """Say what is stale; return the names of what is asked for of it, the cheapest first."""
    code = code_digest()
    found = {
        name: why
        for name, report in reports.items()
        if (why := report.stale(code, design(sweep_of(report.command))))
    }
    accepted = [name for name in found if reports[name].accepted is not None]
    asked = options.names or [n for n in found if options.accepted or n not in accepted]
    stale = sorted(
        found.keys() & set(asked), key=lambda name: (reports[name].minutes or math.inf, name)
    )
    and_asked = " and asked for" if options.names else ""
    print(
        f"{len(stale)} of {len(reports)} reports are stale{and_asked}; {len(reports) - len(found)} "
        f"are of this code or verified under it, {len(accepted)} are accepted as they are "
        f"(docs/reports/README.md).{'' if stale else ' Nothing is to be done.'}"
    )
    for name in stale:
        print(f"  {name}: {found[name]}; {_duration(reports[name])}")
    return stale


def _options(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make reports", description="Renew stale reports.")
    add = parser.add_argument
    add("names", nargs="*", metavar="NAME", help="only these, accepted ones too")
    add("--dry-run", action="store_true", help="only say what is stale; exit code 1 if any is")
    add("--verify", action="store_true", help="run samples again, no whole sweep")
    add("--accepted", action="store_true", help="also what is accepted as it is")
    add("--jobs", type=int, metavar="J", help="trials at a time (one per processor)")
    return parser.parse_args(words)


def sweep_of(command: str) -> Sweep | None:
    """Return the sweep of a command of deqmcl; None: it is by hand."""
    parser = argparse.ArgumentParser()
    first, *rest = shlex.split(command)
    if first == "sweep":
        sweep_command.arguments(parser)
        options = parser.parse_args(rest)
        return asked(options)
    if first == "paper":
        paper_command.arguments(parser)
        given = parser.parse_args(rest)
        names = ("scenario", "trials", "seed", "lag", "particles")
        return suites.paper_sweep(**{name: getattr(given, name) for name in names})
    return None


def design(sweep: Sweep | None) -> str:
    """Return a digest of what a sweep runs, whatever its title; "" of none."""
    return "" if sweep is None else _digest(named(sweep.canonical() | {"title": ""}))


def _duration(report: Report) -> str:
    if sweep_of(report.command) is None:
        return f"by hand: {report.command}"
    took = f"about {report.minutes:.0f} min" if report.minutes else "never timed"
    return f"deqmcl {report.command}, {took} on two cores"


def _renewed(name: str, report: Report, where: Where, *, run: bool) -> Report | None:
    """Return a report as verified or made again; None if it is as stale as it was."""
    sweep = sweep_of(report.command)
    if sweep is None:
        print(f"{name}: it is made by hand: {report.command}.")
        return None
    if report.design in ("", design(sweep)) and _sample(name).exists():
        differs, count = verified(name, sweep, where)
        if not differs:
            print(f"{name}: verified on {count} trials; none differs.")
            checked = Verified(code=code_digest(), on=_today(), trials=count)
            return replace(report, verified=checked, accepted=None)
        print(f"{name}: {differs}.")
    return _made(name, report, where) if run else None


def verified(name: str, sweep: Sweep, where: Where) -> tuple[str, int]:
    """Run a report's sample again.

    Returns:
        How the first trial differs, "" if none does; and how many trials there are.
    """
    with _sample(name).open(newline="", encoding="utf-8") as file:
        kept = {row["trial"]: row for row in csv.DictReader(file)}
    trials = {_name(trial): trial for trial in sweep.distinct()}
    if kept.keys() - trials.keys():
        return "its sweep has no longer the trials of its sample", len(kept)

    def difference(trial: str, found: Outcome) -> str:
        if found.record is None:
            return f"fails: {found.reason}"
        if fingerprint(found.record) == kept[trial]["record"]:
            return ""
        return f"had error {kept[trial]['error']} and has {found.record.scores[0]['error']}"

    chosen = {trial: trials[trial] for trial in kept}
    differing = compare_again(chosen, provenance_of(sweep.cells()), where, difference)
    for trial in kept:
        if trial in differing:
            own = trials[trial]
            words = f"{' '.join(own.words())}, world {own.trial}, {differing[trial]}"
            return f"{len(differing)} of {len(kept)} trials differ; the first, {words}", len(kept)
    return "", len(kept)


def _made(name: str, report: Report, where: Where) -> Report | None:
    """Run a report's command; if all its trials finish, commit its files to docs/reports."""
    folder = FOLDERS / f"{name}-{code_digest()[:8]}"
    begun, new = time.monotonic(), not folder.exists()
    words = ["--out", str(folder), *([] if where.jobs is None else ["--jobs", str(where.jobs)])]
    command = [sys.executable, "-m", "benchmarks", *shlex.split(report.command), *words]
    if subprocess.run(command, cwd=ROOT, check=False).returncode:
        print(f"{name}: its command failed; run make reports again.")
        return None
    took = (time.monotonic() - begun) / 60 * (where.jobs or available_cpus()) / CORES
    results, by = results_in(folder), manifest.read_manifest(folder).identity
    for target, source in report.files.items():
        text = (folder / source).read_text(encoding="utf-8")
        write_text(made.REPORTS / target, with_costs(results) if source == "results.csv" else text)
    write_text(_sample(name), sampled(results, by.code))
    return replace(
        report,
        code=by.code,
        on=_today(),
        design=design(sweep_of(report.command)),
        libraries=by.libraries,
        trials=results.planned,
        minutes=round(took, 1) if new else report.minutes,
        verified=None,
        accepted=None,
    )


def with_costs(results: Results) -> str:
    """Return results.csv with what depends on the machine: ms per step, and over the baseline's."""
    times = results.table[["ms_per_step", "cost"]].map("{:.4g}".format).replace("nan", "")
    return csv_of(results.table.drop(columns=[*FURTHER]).join(times))


def sampled(results: Results, code: str) -> str:
    """Return the sample of a run's trials that is drawn by the digest of its code, as CSV."""
    records = {record.key: record for record in results.finished}
    rows = []
    for key, trial in sample({key: own.trial for key, own in records.items()}, code).items():
        said = (_name(trial), trial.scenario, trial.localizer, *trial.run)
        rows.append([*said, records[key].scores[0]["error"], fingerprint(records[key])])
    return csv_text(_SAMPLED, rows)


def fingerprint(record: TrialRecord) -> str:
    """Return a digest of all that is in a record, times left out: equal only if it is.

    Parts that a record does not have are left out, so that new ones change no other digest.
    """
    there = {name: part for name, part in record_parts(record).items() if part is not None}
    plain = to_builtins(there, str_keys=True, enc_hook=float)
    return _digest(json.dumps(plain, sort_keys=True))[:32]


def _sample(name: str) -> Path:
    return made.REPORTS / "sampled" / f"{name}.csv"


def _name(trial: Trial) -> str:
    return _digest(json.dumps(trial.canonical()))[:16]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _today() -> str:
    return datetime.date.today().isoformat()


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"make reports: {error}")
    except KeyboardInterrupt:
        sys.exit("make reports: stopped; what is finished is kept, and the same command goes on.")
