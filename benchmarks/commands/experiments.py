"""Trials in worlds: the paper's experiment, a lap, a sweep; and folders of their results."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.commands import (
    JOBS,
    MCAP,
    RETRY_FAILED,
    TIMEOUT,
    command,
    group,
    localizers_named,
    option,
    out,
    path,
    seed,
    settings,
    share,
    switch,
    trials,
)
from benchmarks.console import checking, doing, log_warnings, warn

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.sweeps import Sweep
    from benchmarks.sweeps.results import Results

PAPER_NOTE = (
    "Errors mix lengths and unitless components, as the paper's do; SD over trials; entropy in "
    "nats from the four variances. The paper does not say at which offset it took its rows with a "
    'smoother, so its values stand beside x[t] and x[t-L]; "in walls" is the weight on poses '
    "where the robot does not fit."
)

SETTING = (  # of ``setting_sweep``
    option("--scenario", default="paper", metavar="NAME",
        help="a name (deqmcl list) or room.toml (paper)"),
    seed(),
    option("--particles", type=int, default=1000, metavar="N", help="particles (1000)"),
    option("--lag", type=int, default=20, metavar="L", help="lag of the queue (20)"),
)  # fmt: skip


def setting_sweep(options: argparse.Namespace, localizers: Sequence[str], trials: int) -> "Sweep":
    """Return the localizers on the worlds of a setting, with what is set."""
    from benchmarks.setup.documents import settings
    from benchmarks.sweeps.sweepfile import check_localizers, paper_sweep, with_settings

    check_localizers(localizers)
    setting = {name: getattr(options, name) for name in ("scenario", "seed", "lag", "particles")}
    sweep = paper_sweep(localizers=localizers, trials=trials, **setting)
    return with_settings(sweep, settings(options.set))


@command(
    *SETTING,
    trials(10),
    option("--localizers", metavar="A,B,…", help="methods (the paper's and baselines)"),
    settings(),
    JOBS,
    out("results/paper"),
)
def paper_command(options: argparse.Namespace) -> str:
    """Run the paper's experiment: all methods on the same worlds.

    Trials that the output folder already holds are not run again.
    """
    from benchmarks.execution.engines import Where
    from benchmarks.execution.processes import GUEST_SECONDS, Processes
    from benchmarks.experiment import Experiment
    from benchmarks.report.films import write_paper_figures
    from benchmarks.report.page import write_report
    from benchmarks.report.verdict import conclusion
    from benchmarks.sweeps.results import summary
    from benchmarks.sweeps.running import Options, complete
    from benchmarks.sweeps.store import write_files
    from benchmarks.sweeps.sweepfile import PAPER_METHODS

    named, target = options.localizers, options.out
    how = Options(where=Where(jobs=options.jobs), retry_failed=True)
    localizers = PAPER_METHODS if named is None else localizers_named(named)
    sweep = setting_sweep(options, localizers, options.trials)
    with Experiment(sweep).begun(target, how, options.words) as running:
        with Processes(1, timeout=GUEST_SECONDS) as beside:  # where the kernels are loaded
            drawing = beside.submit(write_paper_figures, sweep.distinct(), target / "figures")
            results = running.results()
            drawn = [] if results.failures or results.missing else drawing.result()
            # figures/lap.webp is a lap; three more would be a second of waiting
            files = write_report(target, results, draw=False) + drawn
            complete(results, summary(sweep, results, target, files))
        write_files(target, {"table.md": _paper_table(sweep, results, "github").encode()})
    table = _paper_table(sweep, results, "simple")
    written = [file.relative_to(target) for file in files if file.parent.name != "images"]
    names = ", ".join(map(str, written))
    return f"{table}\n{conclusion(results)}\n\nWritten to {target}: table.md, {names}."


def _paper_table(sweep: "Sweep", results: "Results", style: str) -> str:
    from benchmarks.report.tables import table_1
    from benchmarks.tables import short_name
    from deqmcl_gym.validation import amount

    mark, paper = "# " if style == "github" else "", sweep.scenario == "paper"
    title = (
        f"{mark}Table 1, scenario {short_name(sweep.scenario)}: {amount(sweep.trials, 'world')}, "
        f"N = {sweep.params['particles']}, L = {sweep.lag}, seed {sweep.seed}"
    )
    title += "; the paper's values beside ours" if paper else ""
    table = table_1(results.table, variances=style == "github", paper=paper).text(style)
    return "\n\n".join([title, table, *([PAPER_NOTE] if paper else [])]) + "\n"


@command(
    *SETTING,
    option("--localizer", required=True, metavar="NAME", help="the method"),
    settings(),
    option("--log", type=path, metavar="FILE",
        help="also write the lap as a log: .csv, .csv.gz or .npz"),
    MCAP,
    out(),
)  # fmt: skip
def run_command(options: argparse.Namespace) -> str:
    """Run one lap of one localizer.

    Writes its animation, its errors as CSV, and its trajectories as TUM files (for evo).
    """
    from benchmarks.report.laps import mcap_file, run_lap
    from benchmarks.sweeps.running import check
    from localizers.registry import LOCALIZER

    mcap = mcap_file(options.mcap)
    sweep = setting_sweep(options, [LOCALIZER.complete(options.localizer)], 1)
    with checking():
        check(sweep)
    (trial,) = sweep.distinct()
    log = None if options.log is None else options.log.absolute()
    with doing(f"running and drawing a lap of {trial.localizer}"):
        return run_lap(trial, options.out.absolute(), log, mcap)


@command(
    option("suite", metavar="SUITE|SCENARIO|FILE.toml", help="a suite, a scenario with the paper's "
        "methods, or a sweep file"),
    out(without="results/SUITE"),
    option("--with", dest="added", action="append", default=[], metavar="LOCALIZER[,…]",
        help="localizers to add"),
    settings(),
    trials(),
    seed(None),
    JOBS,
    switch("--dry-run", "list settings and methods, and estimate the time"),
    group(
        "no more worlds than needed",
        switch("--until-decided", "run each method only until it is known to be better or worse "
            "than the baseline, or equivalent"),
        option("--margin", type=share, metavar="M", help="difference that does not matter (5%%)"),
        option("--max-worlds", type=int, metavar="K", help="most worlds of each setting (1000)"),
    ),
    group(
        "where trials run, and what becomes of those that fail",
        option("--dask", metavar="ADDRESS", help="run them by Dask, at this scheduler"),
        option("--shard", metavar="I/N", help="run only every N-th trial, starting with the I-th"),
        TIMEOUT,
        RETRY_FAILED,
    ),
)  # fmt: skip
def sweep_command(options: argparse.Namespace) -> str:
    """Run a suite, a scenario (deqmcl list has both) or a sweep file in TOML; write its report.

    Trials that the output folder already holds are not run again.
    """
    from benchmarks.experiment import Experiment
    from benchmarks.report.page import no_report
    from benchmarks.sweeps.running import check, complete, dry_run

    sweep = asked(options)
    warn(_doubts(sweep))
    if options.dry_run:
        with checking():
            check(sweep)
        with doing("measuring trials"):
            return dry_run(sweep, options.jobs, options.timeout)
    names = ("dask", "timeout", "shard", "retry_failed")
    how = {name: getattr(options, name) for name in names}
    target = options.out or Path("results") / Path(options.suite).stem
    ended = Experiment(sweep).run(options.jobs, target, **how, report=True, command=options.words)
    tables_only = f"\nTables only: {why}" if (why := no_report()) else ""
    return complete(ended.results, f"{ended}{tables_only}", part=options.shard is not None)


def _doubts(sweep: "Sweep") -> list[str]:
    """Read the logs of a sweep; return warnings of them, and what seems wrong with one."""
    from benchmarks.robots.calibration import doubts_of
    from benchmarks.setup.logs import LogScenario
    from benchmarks.setup.names import scenario

    worlds = dict.fromkeys((trial.scenario, trial.world) for trial in sweep.cells())
    named = [(scenario(name), world) for name, world in worlds]
    played = [(of_log, world) for of_log, world in named if isinstance(of_log, LogScenario)]
    if not played:
        return []
    with doing("reading the log and the map"), log_warnings() as warnings:
        doubts = [doubt for log, world in played for doubt in doubts_of(log.changed(world))]
    return [*warnings, *doubts]


def asked(options: argparse.Namespace) -> "Sweep":
    """Return the sweep that ``deqmcl sweep`` is asked for."""
    from benchmarks.experiment import sweep
    from benchmarks.setup.documents import settings
    from benchmarks.sweeps.sweepfile import sweep_named
    from deqmcl_gym.validation import InputError, integer

    added = [name for listed in options.added for name in localizers_named(listed)]
    numbers = {"trials": options.trials, "seed": options.seed}
    keys: dict[str, Any] = {name: value for name, value in numbers.items() if value is not None}
    for flag, value in (("--margin", options.margin), ("--max-worlds", options.max_worlds)):
        if value is not None and not options.until_decided:
            raise InputError(f"{flag} is of --until-decided: give that too.")
    if options.until_decided:
        if options.trials is not None:
            raise InputError("--trials fixes the worlds: give --max-worlds with --until-decided.")
        most = 1000 if options.max_worlds is None else options.max_worlds
        keys["trials"] = integer("--max-worlds", most, low=1, high=100_000)
        keys["until_decided"] = {} if options.margin is None else {"margin": options.margin}
    suite, values = sweep_named(options.suite, added), settings(options.set)
    made = sweep(suite, settings=values, **keys).sweep
    if options.shard and made.until_decided is not None:
        raise InputError(
            "--shard runs a part of all trials, but until all comparisons are decided nobody knows "
            "which these are: leave out --shard or --until-decided."
        )
    return made


@command(
    option("folders", type=path, nargs="+", metavar="DIR", help="folder of results"),
    out(without="DIR itself, if it is one"),
    switch("--latex", "also write the tables in LaTeX, and BibTeX"),
    switch("--pdf", "also write the charts as PDF"),
)
def report_command(options: argparse.Namespace) -> str:
    """Write the report of the finished trials in a folder, or in several of the same worlds.

    That is report.html with its images, and the tables results.csv, trials.csv and
    timings.csv. No code that a folder names is run: animations are those that the sweep drew.
    Several folders may differ in their localizers and agents only, and must be complete. --latex
    and --pdf write what a paper needs into DIR/export: tables.tex (booktabs) with references.bib,
    and the charts.
    """
    from benchmarks.report.page import latex_files, pdf_files, require_report, write_report
    from benchmarks.report.verdict import conclusion, progress
    from benchmarks.sweeps.results import left_out_lines, pooled, results_in
    from benchmarks.sweeps.store import own_folder, write_files
    from deqmcl_gym.validation import InputError

    require_report()
    (first, *more), target = options.folders, options.out or options.folders[0]
    same = target.resolve() == first.resolve()
    if more and same:
        raise InputError("several folders make one report: give --out DIR, a new folder for it.")
    results = pooled(options.folders, options.words) if more else results_in(first)
    for line in left_out_lines(results, Path() if more else first):
        print(line, file=sys.stderr)
    if same and any(record.track is not None for record in results.records):
        raise InputError(
            f"{first} is of deqmcl replay, which writes its report: run it again, or give another "
            "--out."
        )
    files = write_report(target, results, draw=False, of=None if same else first)
    if options.latex or options.pdf:
        if not results.records:
            raise InputError(f"{first} has no finished trial: run its sweep first.")
        contents = latex_files(results) if options.latex else {}
        contents |= pdf_files(results) if options.pdf else {}
        files += write_files(own_folder(target / "export", "tables.tex", "figures"), contents)
    written = [path.relative_to(target) for path in files]
    names = ", ".join(str(path) for path in written if path.parts[0] != "images")
    words = f"{progress(results)}\nWritten to {target}: {names} and their images."
    return f"{words}\n{conclusion(results)}"


@command(
    option("folder", type=path, metavar="DIR", help="folder of results"),
    option("--share", type=share, metavar="S", help="share of trials to run again, beside one of "
        "each setting and method (1%%)"),
    JOBS,
    TIMEOUT,
)  # fmt: skip
def verify_command(options: argparse.Namespace) -> str:
    """Run a sample of a folder's finished trials again, and compare their results.

    The sample is the first world of each setting and method, and 1 % of the others (--share), drawn
    by the digest of the code. If all results are the same to the last digit, the folder's manifest
    says so, and deqmcl sweep goes on with what is there; if not, the exit code is 1. A sample
    cannot prove what happens rarely: run the sweep again for numbers that must hold without a
    doubt.
    """
    from benchmarks.execution.engines import Where
    from benchmarks.sweeps.running import SAMPLED, verify
    from deqmcl_gym.validation import number

    part = SAMPLED if options.share is None else number("--share", options.share, low=0, high=1)
    return verify(options.folder, Where(jobs=options.jobs, timeout=options.timeout), part)
