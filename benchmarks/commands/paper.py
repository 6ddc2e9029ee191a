"""Run the paper's experiment: all methods on the same worlds.

Trials that the output folder already holds are not run again.
"""

import argparse
from typing import TYPE_CHECKING

from benchmarks.commands import shared

if TYPE_CHECKING:
    from benchmarks.sweeps.design import Sweep
    from benchmarks.sweeps.results import Results

NOTE = (
    "Errors mix lengths and unitless components, as the paper's do; SD over trials; entropy in "
    "nats from the four variances. The paper does not say at which offset it took its rows with a "
    'smoother, so its values stand beside x[t] and x[t-L]; "in walls" is the weight on poses '
    "where the robot does not fit."
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    shared.add_setting(parser)
    shared.add_trials(parser, 10)
    parser.add_argument(
        "--localizers", metavar="A,B,…", help="methods, comma-separated (the paper's and baselines)"
    )
    shared.add_set(parser)
    shared.add_jobs(parser)
    shared.add_out(parser, "results/paper")


def run(options: argparse.Namespace) -> str:
    """Run the command; return what to print."""
    from benchmarks.execution import prepare

    prepare()  # while this process loads what it needs
    from benchmarks.execution.engines import Where
    from benchmarks.execution.processes import GUEST_SECONDS, Processes
    from benchmarks.experiment import Experiment
    from benchmarks.files import write_files
    from benchmarks.pictures.figures import chosen, write_paper_figures
    from benchmarks.report.verdict import conclusion
    from benchmarks.report.writing import load, write_report
    from benchmarks.sweeps.results import summary
    from benchmarks.sweeps.running import Options, complete
    from benchmarks.sweeps.suites import PAPER_METHODS

    out, named = options.out, options.localizers
    how = Options(where=Where(jobs=options.jobs), retry_failed=True)
    localizers = PAPER_METHODS if named is None else shared.localizers_named(named)
    sweep = shared.setting_sweep(options, localizers, options.trials)
    if not (out / "report.html").exists():
        load()  # while the workers load theirs
    with Experiment(sweep).begun(out, how, options.words) as running:
        with Processes(1, timeout=GUEST_SECONDS) as beside:  # where the kernels are loaded
            drawing = beside.submit(write_paper_figures, chosen(sweep.distinct()), out / "figures")
            results = running.results()
            drawn = [] if results.failures or results.missing else drawing.result()
            # figures/lap.webp is a lap; three more would be a second of waiting
            files = write_report(out, results, draw=False) + drawn
            complete(results, summary(sweep, results, out, files))
        write_files(out, {"table.md": _table(sweep, results, "github").encode()})
    named = ", ".join(str(file.relative_to(out)) for file in files if file.parent.name != "images")
    table = _table(sweep, results, "simple")
    return f"{table}\n{conclusion(results)}\n\nWritten to {out}: table.md, {named}."


def _table(sweep: "Sweep", results: "Results", style: str) -> str:
    from benchmarks.tables.comparison import reading, table_1
    from benchmarks.tables.text import short_name

    worlds = "1 world" if sweep.trials == 1 else f"{sweep.trials} worlds"
    title = (
        f"Table 1, scenario {short_name(sweep.scenario)}: {worlds}, "
        f"N = {sweep.params['particles']}, L = {sweep.lag}, seed {sweep.seed}"
    )
    mark = "# " if style == "github" else ""
    rows = results.table
    parts = [f"{mark}{title}; the paper's values beside ours", table_1(rows, style), NOTE]
    return "\n\n".join([*parts, *filter(None, [reading(rows)])]) + "\n"
