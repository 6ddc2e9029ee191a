"""Write leaderboard.html, .md and .csv from folders of results: a ranking of their methods.

The folders differ in their localizers only, or are held-out runs of the same submissions. Those of
another scenario, other worlds or another baseline are refused. Nothing is run, unless with
--verify: then each folder is checked as a submission (its suite, all trials, the files of its
plug-ins, its held-out seed), and a sample of its trials, drawn anew each time, is run again. What
is wrong is said in a sentence each, and the exit code is 1.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks.commands import shared
from benchmarks.console import doing

if TYPE_CHECKING:  # --help loads nothing heavy
    from benchmarks.sweeps.submissions import Handed

_OF_VERIFY = ("looked_up", "share", "jobs", "timeout")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("folders", type=shared.folder, nargs="+", metavar="DIR", help="folders of complete results")
    shared.add_out(parser, "results/leaderboard")
    add("--verify", action="store_true", help="check each folder, and run a sample of it again")
    add(
        "--looked-up",
        action="append",
        default=[],
        metavar="VALUE",
        help="with --verify: a value of --held-out that you looked up, and that was published "
        "after the submission was handed in (one --looked-up each)",
    )
    shared.add_share(parser)
    shared.add_jobs(parser)
    shared.add_timeout(parser)


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.files import own_folder, write_part
    from benchmarks.report.writing import require_report
    from deqmcl_gym.validation import InputError

    require_report()
    given = [name for name in _OF_VERIFY if vars(options)[name] not in (None, [])]
    if given and not options.verify:
        raise InputError(f"--{given[0].replace('_', '-')} is of --verify: give that too.")
    from benchmarks.report.leaderboard import leaderboard_files
    from benchmarks.sweeps.submissions import handed_in

    with doing("reading the folders"):
        read = handed_in(options.folders)
    if options.verify:
        read = _verified(read, options)
    with doing("comparing the folders"):
        contents = leaderboard_files(read, options.words)
    files = write_part(own_folder(options.out, "leaderboard"), "leaderboard", contents)
    said = [
        f"{one.folder}: {one.label}; {one.known_by}. Submission {one.digest}."
        for one in read
        if options.verify
    ]
    written = f"Written to {options.out}: {', '.join(path.name for path in files)}."
    return "\n".join([*said, written])


def _verified(read: "Sequence[Handed]", options: argparse.Namespace) -> "list[Handed]":
    """Return the folders with a sample of each run again.

    Raises:
        RefusedError: something is wrong with one; all that is, is said.
        InputError: a bad option.
    """
    from benchmarks.execution.starting import prepare

    prepare()  # while this process loads what it needs
    from benchmarks.execution.apart import answered_within
    from benchmarks.execution.engines import Where
    from benchmarks.sweeps.submissions import faults, verified
    from deqmcl_gym.validation import InputError, one_of

    where, share = Where(jobs=options.jobs, timeout=options.timeout), shared.share_of(options)
    where.check()
    values = [one.held_out.value for one in read if one.held_out]
    if options.looked_up and not values:
        raise InputError("--looked-up is of held-out runs, and no folder has one: leave it out.")
    for value in options.looked_up:
        one_of("--looked-up", value, values)
    with answered_within(options.timeout):
        with doing("checking the folders"):
            wrong = [fault for one in read for fault in faults(one)]
        _refuse(wrong)
        again = [verified(one, where, share) for one in read]
    _refuse([one.again.sentence for one in again if one.again and one.again.differing])
    return [
        replace(one, looked_up=bool(one.held_out and one.held_out.value in options.looked_up))
        for one in again
    ]


def _refuse(wrong: Sequence[str]) -> None:
    """Say all that is wrong, a line each."""
    from benchmarks.sweeps.submissions import RefusedError
    from deqmcl_gym.validation import one_line

    for sentence in wrong[:-1]:
        print(f"deqmcl: {one_line(sentence)}", file=sys.stderr)
    if wrong:
        raise RefusedError(wrong[-1])
