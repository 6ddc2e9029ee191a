"""Run a sample of a folder's finished trials again, and compare their results.

The sample is the first world of each setting and method, and 1 % of the others (--share), drawn by
the digest of the code. If all results are the same to the last digit, the folder's manifest says
so, and deqmcl sweep goes on with what is there; if not, the exit code is 1. A sample cannot prove
what happens rarely: run the sweep again for numbers that must hold without a doubt.
"""

import argparse

from benchmarks.commands import shared


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("folder", type=shared.folder, metavar="DIR", help="folder of results")
    shared.add_share(parser)
    shared.add_jobs(parser)
    shared.add_timeout(parser)


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution import prepare

    prepare()  # while this process loads what it needs
    from benchmarks.execution.engines import Where
    from benchmarks.sweeps.verifying import verify

    where, share = Where(jobs=options.jobs, timeout=options.timeout), shared.share_verified(options)
    return verify(options.folder, where, share)
