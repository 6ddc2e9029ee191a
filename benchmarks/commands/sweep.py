"""Run a suite (deqmcl list names them) or a sweep file in TOML, and write its report.

Trials that the output folder already holds are not run again.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.commands import shared
from benchmarks.console import doing

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.sweeps.design import Sweep


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("suite", metavar="SUITE|FILE.toml", help="a suite or a sweep file")
    add("--out", type=shared.folder, metavar="DIR", help="output folder (results/SUITE)")
    add(
        "--with",
        dest="added",
        action="append",
        default=[],
        metavar="LOCALIZER[,…]",
        help="localizers to add",
    )
    add("--agents", metavar="A,B,…", help="who drives, each in turn; the first is the baseline")
    shared.add_trials(parser)
    shared.add_seed(parser, None)
    shared.add_params(parser)
    shared.add_jobs(parser)
    add("--executor", default="process", metavar="E", help="process, dask or module:factory")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler (a new cluster on this machine)")
    add(
        "--until-decided",
        action="store_true",
        help="run each method only until it is known to be better or worse than the baseline, or "
        "equivalent",
    )
    add(
        "--margin",
        type=shared.share,
        metavar="M",
        help="with --until-decided: difference that does not matter (5%%)",
    )
    add(
        "--max-worlds",
        type=int,
        metavar="K",
        help="with --until-decided: most worlds of each setting (1000)",
    )
    add("--shard", metavar="I/N", help="run only every N-th trial, starting with the I-th")
    shared.add_timeout(parser)
    add("--retry-failed", action="store_true", help="run failed trials again")
    add(
        "--adopt",
        action="store_true",
        help="go on in a folder of other code, libraries or plug-ins, if deqmcl verify finds no "
        "number that differs",
    )
    add("--fail-fast", action="store_true", help="stop at the first failed trial")
    add(
        "--mcap",
        type=shared.folder,
        metavar="DIR",
        help="also write the runs of the report's animations, for Foxglove and Lichtblick (needs "
        "the extra view)",
    )
    add("--dry-run", action="store_true", help="list settings and methods, and estimate the time")
    add("--yes", action="store_true", help="run more than 100,000 trials without confirmation")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.starting import prepare

    if options.executor == "process":
        prepare()  # while this process loads what it needs
    return _swept(options)


def stopping(options: argparse.Namespace, sweep: "Sweep") -> "Sweep":
    """Return a sweep with what the options say of when it stops.

    Raises:
        InputError: options that do not go together, or a bad value.
    """
    from benchmarks.sweeps.design import UntilDecided
    from deqmcl_gym.validation import InputError, integer

    said = {"--margin": options.margin, "--max-worlds": options.max_worlds}
    given = [name for name, value in said.items() if value is not None]
    if not options.until_decided:
        if given:
            raise InputError(f"{given[0]} is of --until-decided: give that too.")
        if options.shard and sweep.until_decided:
            raise InputError(_NO_SHARD)
        return sweep
    if options.shard:
        raise InputError(_NO_SHARD)
    if options.trials is not None:
        raise InputError("--trials fixes the worlds: give --max-worlds with --until-decided.")
    most = 1000 if options.max_worlds is None else options.max_worlds
    trials = integer("--max-worlds", most, low=1, high=100_000)
    until = UntilDecided() if options.margin is None else UntilDecided(margin=options.margin)
    return replace(sweep, trials=trials, until_decided=until)


_NO_SHARD = (
    "--shard runs a part of all trials, but until all comparisons are decided nobody knows which "
    "these are: leave out --shard or --until-decided."
)


def _swept(options: argparse.Namespace) -> str:
    from benchmarks.execution.engines import Where
    from benchmarks.pictures.messages import check_folder
    from benchmarks.report.animations import write_laps
    from benchmarks.report.verdict import conclusion
    from benchmarks.report.writing import no_report, write_report
    from benchmarks.sweeps.dry_run import dry_run
    from benchmarks.sweeps.manifest import of_sweep, taken_over
    from benchmarks.sweeps.results import incomplete_sentence, named_as_in, summary
    from benchmarks.sweeps.running import (
        Options,
        TrialsFailedError,
        begun,
        check,
        refuse_too_many,
        shard_of,
    )
    from benchmarks.sweeps.suites import sweep_named
    from benchmarks.sweeps.verifying import adopt
    from localizers import parameters

    added = [name for listed in options.added for name in shared.localizers_named(listed)]
    how = Options(
        where=Where(
            jobs=options.jobs,
            executor=options.executor,
            scheduler=options.scheduler,
            timeout=options.timeout,
        ),
        shard=None if options.shard is None else shard_of(options.shard),
        retry_failed=options.retry_failed,
        fail_fast=options.fail_fast,
    )
    how.where.check()
    if options.mcap is not None:
        check_folder(options.mcap)
    with shared.checking():
        driven = shared.with_agents(sweep_named(options.suite, added), options.agents)
        sweep = stopping(options, shared.changed(options, driven))
        for name in added:
            parameters(name)
        refuse_too_many(sweep, yes=options.yes)
        check(sweep)
    if options.dry_run:
        with doing("measuring trials"):
            return dry_run(sweep, how)
    out = options.out or Path("results") / Path(options.suite).stem
    ours = of_sweep(named_as_in(out, sweep), options.words)
    if options.adopt and (said := adopt(out, ours, how.where)):
        print(said)
    taken_over(out, ours)
    with begun(sweep, out, how, command=options.words) as running:
        results = running.results()
        files = write_report(out, results)
        laps = "" if options.mcap is None else write_laps(results, options.mcap)
    lines = [summary(sweep, results, out, files), conclusion(results), laps]
    if (why := no_report()) is not None:
        lines.append(f"\nTables only: {why}")
    text = "\n".join(filter(None, lines))
    incomplete = incomplete_sentence(results)
    if incomplete and (results.failures or how.shard is None):
        print(text)
        raise TrialsFailedError(incomplete)
    return text
