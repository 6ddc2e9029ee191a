"""Run a suite (deqmcl list names them) or a sweep file in TOML, and write its report.

Trials that the output folder already holds are not run again.
"""

import argparse
from pathlib import Path

from benchmarks.commands import shared
from benchmarks.console import doing


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("suite", metavar="SUITE|FILE.toml", help="a suite, a family of suites or a sweep file")
    add("--out", type=shared.folder, metavar="DIR", help="output folder (results/SUITE)")
    add(
        "--with",
        dest="added",
        action="append",
        default=[],
        metavar="LOCALIZER[,…]",
        help="localizers to add",
    )
    shared.add_trials(parser)
    shared.add_seed(parser, None)
    shared.add_params(parser)
    shared.add_jobs(parser)
    add("--executor", default="process", metavar="E", help="process, dask or module:factory")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler (a new cluster on this machine)")
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
    add("--dry-run", action="store_true", help="list settings and methods, and estimate the time")
    add("--yes", action="store_true", help="run more than 100,000 trials without confirmation")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution.starting import prepare

    if options.executor == "process":
        prepare()  # while this process loads what it needs
    from benchmarks.execution.apart import answered_within

    with answered_within(options.timeout):
        return _swept(options)


def _swept(options: argparse.Namespace) -> str:
    from benchmarks.execution.apart import parameters
    from benchmarks.execution.engines import Where
    from benchmarks.report.words import conclusion
    from benchmarks.report.writing import no_report, write_report
    from benchmarks.sweeps.dry_run import dry_run
    from benchmarks.sweeps.manifest import of_sweep, taken_over
    from benchmarks.sweeps.results import incomplete_sentence, summary
    from benchmarks.sweeps.running import (
        Options,
        TrialsFailedError,
        begun,
        check,
        refuse_too_many,
        shard_of,
    )
    from benchmarks.sweeps.suites import sweeps_named
    from benchmarks.sweeps.verifying import adopt

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
    with shared.checking():
        sweeps = shared.changed(options, sweeps_named(options.suite, added))
        for name in added:
            parameters(name)
        for sweep in sweeps.values():
            refuse_too_many(sweep, yes=options.yes)
            check(sweep)
    if options.dry_run:
        with doing("measuring trials"):
            return "\n\n".join(dry_run(sweep, how) for sweep in sweeps.values())
    out = options.out or Path("results") / Path(options.suite).stem
    texts: list[str] = []
    failed: list[str] = []
    for part, sweep in sweeps.items():
        ours = of_sweep(sweep, options.words)
        if options.adopt and (said := adopt(out / part, ours, how.where)):
            print(said)
        taken_over(out / part, ours)
    for part, sweep in sweeps.items():
        with begun(sweep, out / part, how, command=options.words) as running:
            results = running.results()
            files = write_report(out / part, results)
        texts.append(f"{summary(sweep, results, out / part, files)}\n{conclusion(results).text}")
        if results.failures or how.shard is None:
            failed += filter(None, [incomplete_sentence(results)])
    if (why := no_report()) is not None:
        texts.append(f"Tables only: {why}")
    if failed:
        print("\n\n".join(texts))
        raise TrialsFailedError(" ".join(failed))
    return "\n\n".join(texts)
