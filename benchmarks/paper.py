"""``deqmcl paper``: the paper's experiment, its Table 1 and its figures."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.experiment import Experiment
from benchmarks.files import write_text
from benchmarks.pictures.figures import FIG_4_METHODS
from benchmarks.pictures.gallery import Gallery
from benchmarks.sweeps.manifest import refuse_sweep, seeds
from benchmarks.sweeps.running import check, run_trials
from benchmarks.sweeps.store import Store
from benchmarks.tables.comparison import Comparison, results_csv
from benchmarks.tables.panels import comparisons
from benchmarks.tables.table_1 import reading, table_1, timings_csv, trials_csv
from benchmarks.trials.provenance import environment
from deqmcl_gym.validation import integer

NOTE = (
    "Errors mix px and unitless components, as the paper's do; SD over trials; entropy in nats "
    "from the four variances. The paper does not say at which offset it took its rows with a "
    'smoother, so its values stand beside x[t] and x[t-L]; "in walls" is the weight on poses '
    "where the robot does not fit."
)


def run_paper(experiment: Experiment, out: Path, *, jobs: int, command: Sequence[str]) -> str:
    """Run the experiment (what ``out`` already holds is not run again); return what to print.

    Raises:
        InputError: something of it is refused, or ``out`` is the folder of a sweep.
    """
    integer("--jobs", jobs, low=1)
    sweep = experiment.sweep
    check(sweep)
    store = Store(out)
    refuse_sweep(out)
    suite = sweep.distinct()
    shown = [t for t in suite if t.trial == 0 and t.localizer in FIG_4_METHODS]
    figures = Gallery(shown, out / "figures")
    draw = None if figures.current() else figures.draw
    records = run_trials(suite, store, jobs=jobs, errand=draw)
    rows = comparisons(records)
    write_text(out / "results.csv", results_csv(rows))
    write_text(out / "trials.csv", trials_csv(records))
    write_text(out / "timings.csv", timings_csv(records))
    write_text(out / "table.md", _markdown(rows, experiment))
    write_text(out / "manifest.json", _manifest(experiment, command))
    listing = ", ".join(str(path.relative_to(out)) for path in figures.files)
    return "\n\n".join(
        part
        for part in (
            f"{_title(experiment)}\n\n{table_1(rows, 'simple')}",
            NOTE,
            reading(rows),
            f"Written to {out}: results.csv, trials.csv, timings.csv, table.md, manifest.json"
            + (f", {listing}" if listing else "")
            + ".",
        )
        if part
    )


def _title(experiment: Experiment) -> str:
    worlds = "1 world" if experiment.trials == 1 else f"{experiment.trials} worlds"
    return (
        f"Table 1, scenario {experiment.scenario}: {worlds}, {experiment.words}; "
        "the paper's values beside ours"
    )


def _markdown(rows: Sequence[Comparison], experiment: Experiment) -> str:
    parts = [f"# {_title(experiment)}", table_1(rows, "github"), NOTE, reading(rows)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _manifest(experiment: Experiment, command: Sequence[str]) -> str:
    configuration: dict[str, Any] = vars(experiment) | {"localizers": list(experiment.localizers)}
    content = {
        "command": list(command),
        "configuration": configuration,
        "seeds": seeds(experiment.seed),
        "environment": environment(),
    }
    return json.dumps(content, indent=2) + "\n"
