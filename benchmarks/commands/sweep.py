"""Run a suite (deqmcl list names them) or a sweep file in TOML, and write its report.

Trials that the output folder already holds are not run again.
"""

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.commands import shared
from benchmarks.console import checking, doing

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.sweeps.design import Sweep

MANY = 100_000  # trials; more are run only with --yes


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add, switch = parser.add_argument, partial(parser.add_argument, action="store_true")
    add("suite", metavar="SUITE|FILE.toml", help="a suite or a sweep file")
    add("--out", type=shared.folder, metavar="DIR", help="output folder (results/SUITE)")
    add("--with", dest="added", action="append", default=[], metavar="LOCALIZER[,…]",
        help="localizers to add")  # fmt: skip
    add("--agents", metavar="A,B,…", help="who drives, each in turn; the first is the baseline")
    shared.add_trials(parser)
    shared.add_seed(parser, None)
    shared.add_params(parser)
    shared.add_jobs(parser)
    add("--executor", default="process", metavar="E", help="process, dask or module:factory")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler (a new cluster on this machine)")
    switch("--until-decided", help="run each method only until it is known to be better or worse "
        "than the baseline, or equivalent")  # fmt: skip
    add("--margin", type=shared.share, metavar="M",
        help="with --until-decided: difference that does not matter (5%%)")  # fmt: skip
    add("--max-worlds", type=int, metavar="K",
        help="with --until-decided: most worlds of each setting (1000)")  # fmt: skip
    add("--shard", metavar="I/N", help="run only every N-th trial, starting with the I-th")
    shared.add_timeout(parser)
    switch("--retry-failed", help="run failed trials again")
    switch("--adopt", help="go on in a folder of other code, libraries or plug-ins, if deqmcl "
        "verify finds no number that differs")  # fmt: skip
    switch("--fail-fast", help="stop at the first failed trial")
    add("--mcap", type=shared.folder, metavar="DIR", help="also write the runs of the report's "
        "animations, for Foxglove and Lichtblick (needs the extra view)")  # fmt: skip
    switch("--dry-run", help="list settings and methods, and estimate the time")
    switch("--yes", help="run more than 100,000 trials without confirmation")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.starting import prepare

    if options.executor == "process":
        prepare()  # while this process loads what it needs
    from benchmarks.experiment import Experiment
    from benchmarks.pictures.messages import check_folder
    from benchmarks.report.animations import write_laps
    from benchmarks.report.writing import no_report
    from benchmarks.sweeps.running import check, complete, dry_run, shard_of
    from deqmcl_gym.validation import InputError

    if options.mcap is not None:
        check_folder(options.mcap)
    sweep = asked(options)
    if sweep.combinations > MANY and not options.yes:
        raise InputError(
            f"the sweep has {sweep.combinations:,} trials, more than {MANY:,}: give --yes to run "
            "them all, or vary less."
        )
    if options.dry_run:
        shards = shard_of(options.shard)[1] if options.shard else 1
        with checking():
            check(sweep)
        with doing("measuring trials"):
            return dry_run(sweep, options.jobs, options.timeout, shards)
    names = ("executor", "scheduler", "timeout", "shard", "retry_failed", "fail_fast", "adopt")
    how = {name: getattr(options, name) for name in names}
    out = options.out or Path("results") / Path(options.suite).stem
    found = Experiment(sweep).run(options.jobs, out, **how, report=True, command=options.words)
    laps = "" if options.mcap is None else write_laps(found.results, options.mcap)
    tables_only = f"\nTables only: {why}" if (why := no_report()) else ""
    text = "\n".join(filter(None, [str(found), laps, tables_only]))
    return complete(found.results, text, part=options.shard is not None)


def asked(options: argparse.Namespace) -> "Sweep":
    """Return the sweep that is asked for."""
    from benchmarks.sweeps.design import UntilDecided
    from benchmarks.sweeps.suites import sweep_named
    from deqmcl_gym.validation import InputError, integer
    from localizers import parameters

    added = [name for listed in options.added for name in shared.localizers_named(listed)]
    driven = shared.with_agents(sweep_named(options.suite, added), options.agents)
    sweep = shared.with_options(options, driven)
    for name in added:
        parameters(name)
    until = UntilDecided() if options.until_decided else None
    for flag, value in (("--margin", options.margin), ("--max-worlds", options.max_worlds)):
        if value is not None and until is None:
            raise InputError(f"{flag} is of --until-decided: give that too.")
    if options.shard and (until or sweep.until_decided):
        raise InputError(
            "--shard runs a part of all trials, but until all comparisons are decided nobody knows "
            "which these are: leave out --shard or --until-decided."
        )
    if until is None:
        return sweep
    if options.trials is not None:
        raise InputError("--trials fixes the worlds: give --max-worlds with --until-decided.")
    if options.margin is not None:
        until = UntilDecided(margin=options.margin)
    most = 1000 if options.max_worlds is None else options.max_worlds
    trials = integer("--max-worlds", most, low=1, high=100_000)
    return replace(sweep, trials=trials, until_decided=until)
