"""The ``deqmcl`` command: parsing only; what is heavy is imported by the command that needs it."""

import argparse
import difflib
import io
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

BAD_INPUT, FAILED, INTERRUPTED = 2, 3, 130


class _Parser(argparse.ArgumentParser):
    """Says in one sentence what is wrong with a command line, and nothing else."""

    def error(self, message: str) -> NoReturn:
        sentence = message.rstrip(".")
        if message.startswith("unrecognized arguments: "):
            given = message.removeprefix("unrecognized arguments: ").split()[0]
            sentence = f"unknown argument {given!r}"
            known = [flag for action in self._actions for flag in action.option_strings]
            nearest = difflib.get_close_matches(given.split("=")[0], known, n=1)
            sentence += f" (did you mean {nearest[0]}?)" if nearest else ""
        print(f"{self.prog}: {sentence}; see {self.prog} --help.", file=sys.stderr)
        raise SystemExit(BAD_INPUT)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code: 0 done, 2 bad input, 3 failed, 130 interrupted."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # θ, for a terminal that has none
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = _parse(given)
    try:
        print(options.run(options, given))
    except KeyboardInterrupt:
        print("deqmcl: interrupted; finished trials are kept.", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        if options.debug:
            raise
        return _explain(error)
    return 0


def _explain(error: Exception) -> int:
    from deqmcl_gym.validation import InputError

    if isinstance(error, InputError):
        print(f"deqmcl: {error}", file=sys.stderr)
        return BAD_INPUT
    if isinstance(error, OSError) and error.strerror:
        words = f"{error.strerror}: {error.filename}" if error.filename else error.strerror
        print(f"deqmcl: {words}.", file=sys.stderr)
        return FAILED
    kind = "" if isinstance(error, RuntimeError) else f"{type(error).__name__}: "
    words = " ".join(str(error).split())  # on one line, whatever raised it
    print(f"deqmcl: {kind}{words} (--debug shows where)", file=sys.stderr)
    return FAILED


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = _Parser(
        prog="deqmcl",
        description="Benchmark of robot self-localization that knows its plan.",
        allow_abbrev=False,
    )
    common = _Parser(add_help=False)
    common.add_argument(
        "--debug", action="store_true", help="show a traceback when something fails"
    )
    common.add_argument("--seed", type=int, default=0, help="root of all randomness (0)")
    common.add_argument(
        "--preset", default="paper", help="the world: paper, matched or sharp (paper)"
    )
    common.add_argument("--particles", type=int, default=1000, metavar="N", help="particles (1000)")
    common.add_argument("--lag", type=int, default=20, metavar="L", help="lag of the queue (20)")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    paper = commands.add_parser(
        "paper",
        parents=[common],
        allow_abbrev=False,
        help="run the paper's experiment: Table 1 and figures",
        description="Run the paper's experiment: all methods on the same worlds; what the output "
        "folder already holds is not run again.",
    )
    paper.add_argument("--trials", type=int, default=10, metavar="K", help="worlds (10)")
    paper.add_argument(
        "--localizers", metavar="A,B,…", help="methods, comma-separated (the paper's and baselines)"
    )
    paper.add_argument("--jobs", type=int, metavar="J", help="processes (one per processor)")
    paper.add_argument(
        "--out", type=Path, default=Path("results/paper"), metavar="DIR", help="(results/paper)"
    )
    paper.set_defaults(run=_paper)

    lap = commands.add_parser(
        "run",
        parents=[common],
        allow_abbrev=False,
        help="run one lap: animation and error curve",
        description="Run one lap of one localizer: its animation and its error curve.",
    )
    lap.add_argument("--localizer", required=True, metavar="NAME", help="the method")
    lap.add_argument("--out", type=Path, required=True, metavar="DIR", help="output folder")
    lap.set_defaults(run=_lap)
    options, unknown = parser.parse_known_args(arguments)
    if unknown:  # said by the command's own parser, which knows its flags
        command = {"paper": paper, "run": lap}[options.command]
        command.error(f"unrecognized arguments: {' '.join(unknown)}")
    return options


def _paper(options: argparse.Namespace, given: Sequence[str]) -> str:
    from benchmarks.paper import PaperExperiment, run_paper
    from benchmarks.suites import PAPER_METHODS
    from benchmarks.sweep import available_cpus

    named = options.localizers
    methods = PAPER_METHODS if named is None else tuple(_split(named))
    experiment = PaperExperiment(
        preset=options.preset,
        localizers=methods,
        trials=options.trials,
        seed=options.seed,
        particles=options.particles,
        lag=options.lag,
    )
    jobs = available_cpus() if options.jobs is None else options.jobs
    return run_paper(experiment, options.out, jobs=jobs, command=["deqmcl", *given])


def _lap(options: argparse.Namespace, given: Sequence[str]) -> str:
    del given
    from benchmarks.lap_run import LapRun, run_lap

    lap = LapRun(
        localizer=options.localizer,
        preset=options.preset,
        seed=options.seed,
        particles=options.particles,
        lag=options.lag,
    )
    return run_lap(lap, options.out)


def _split(listed: str) -> list[str]:
    return [name for part in listed.split(",") if (name := part.strip())]
