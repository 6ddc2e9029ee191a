"""Run a suite, a scenario (deqmcl list has both) or a sweep file in TOML; write its report.

Trials that the output folder already holds are not run again.
"""

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.commands import shared
from benchmarks.console import checking, doing, log_warnings, warn

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.sweeps.design import Sweep

MANY = 100_000  # trials; more are run only with --yes


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add, switch = parser.add_argument, partial(parser.add_argument, action="store_true")
    add("suite", metavar="SUITE|SCENARIO|FILE.toml", help="a suite, a scenario with the paper's "
        "methods, or a sweep file")  # fmt: skip
    shared.add_out(parser, without="results/SUITE")
    add("--with", dest="added", action="append", default=[], metavar="LOCALIZER[,…]",
        help="localizers to add")  # fmt: skip
    shared.add_set(parser)
    shared.add_trials(parser)
    shared.add_seed(parser, None)
    shared.add_jobs(parser)
    switch("--dry-run", help="list settings and methods, and estimate the time")
    decided = parser.add_argument_group("no more worlds than needed")
    decided.add_argument("--until-decided", action="store_true", help="run each method only until "
        "it is known to be better or worse than the baseline, or equivalent")  # fmt: skip
    decided.add_argument("--margin", type=shared.share, metavar="M",
        help="difference that does not matter (5%%)")  # fmt: skip
    decided.add_argument("--max-worlds", type=int, metavar="K",
        help="most worlds of each setting (1000)")  # fmt: skip
    where = parser.add_argument_group("where trials run, and what becomes of those that fail")
    add, switch = where.add_argument, partial(where.add_argument, action="store_true")
    add("--executor", default="process", metavar="E", help="process, dask or module:factory")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler (a new cluster on this machine)")
    add("--shard", metavar="I/N", help="run only every N-th trial, starting with the I-th")
    shared.add_timeout(where)
    switch("--retry-failed", help="run failed trials again")
    switch("--fail-fast", help="stop at the first failed trial")
    switch("--adopt", help="go on in a folder of other code, libraries or plug-ins, if deqmcl "
        "verify finds no number that differs")  # fmt: skip
    switch("--yes", help="run more than 100,000 trials without confirmation")
    add("--mcap", type=shared.folder, metavar="DIR", help="also write the runs of the report's "
        "animations, for Foxglove and Lichtblick (needs the extra view)")  # fmt: skip


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution import prepare

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
    warn(_misfits(sweep))
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


def _misfits(sweep: "Sweep") -> list[str | None]:
    """Read the logs of a sweep; return warnings of them, and that one does not fit its map."""
    from benchmarks.robots.replaying import disagreement
    from benchmarks.setup.logs import LogScenario
    from benchmarks.setup.names import scenario

    worlds = dict.fromkeys((trial.scenario, trial.world) for trial in sweep.cells())
    named = [(scenario(name), world) for name, world in worlds]
    played = [(own, world) for own, world in named if isinstance(own, LogScenario)]
    if not played:
        return []
    with doing("reading the log and the map"), log_warnings() as said:
        misfits = [disagreement(own.changed(world)) for own, world in played]
    return [*said, *misfits]


def asked(options: argparse.Namespace) -> "Sweep":
    """Return the sweep that is asked for."""
    from benchmarks.experiment import base_of, sweep
    from benchmarks.setup.documents import settings
    from deqmcl_gym.validation import InputError, integer
    from localizers import parameters

    added = [name for listed in options.added for name in shared.localizers_named(listed)]
    keys: dict[str, Any] = {}
    if options.trials is not None:
        keys["trials"] = integer("--trials", options.trials, low=1, high=100_000)
    if options.seed is not None:
        keys["seed"] = integer("--seed", options.seed)
    for flag, value in (("--margin", options.margin), ("--max-worlds", options.max_worlds)):
        if value is not None and not options.until_decided:
            raise InputError(f"{flag} is of --until-decided: give that too.")
    if options.until_decided:
        if options.trials is not None:
            raise InputError("--trials fixes the worlds: give --max-worlds with --until-decided.")
        most = 1000 if options.max_worlds is None else options.max_worlds
        keys["trials"] = integer("--max-worlds", most, low=1, high=100_000)
        keys["until_decided"] = {} if options.margin is None else {"margin": options.margin}
    made = sweep(base_of(options.suite, added), settings=settings(options.set), **keys).sweep
    for name in added:
        parameters(name)
    if options.shard and made.until_decided:
        raise InputError(
            "--shard runs a part of all trials, but until all comparisons are decided nobody knows "
            "which these are: leave out --shard or --until-decided."
        )
    return made
