"""How far a sweep has come: what a store holds of it, which trials it still needs, in words."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.setup import documents, overrides
from benchmarks.sweeps import Sweep, by_cell, manifest
from benchmarks.sweeps.manifest import Manifest, differences
from benchmarks.sweeps.store import Store, named
from benchmarks.sweeps.sweepfile import sweep_of
from benchmarks.tables import BASELINE
from benchmarks.tables.comparison import decide, decisions_table, results_table
from benchmarks.tables.panels import Panel, panels, trial_words
from benchmarks.tables.signals import plans_table
from benchmarks.tables.stats import FIRST, Rule
from benchmarks.trials import Method, Setting, Trial
from benchmarks.trials.scoring import Finished
from deqmcl_gym.files import command_line
from deqmcl_gym.validation import InputError, one_line


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A trial that could not be finished, and why, in one sentence."""

    trial: Trial
    reason: str


@dataclass(frozen=True, kw_only=True)
class Results:
    """A sweep as far as it has come.

    Trials of the same setting (scenario, world, assumed, disturbance, lag, seed) and the same
    number are paired over methods (localizer, params).
    """

    title: str
    records: list[Finished]  #: trials that ended, in the sweep's order
    failures: list[Failure]  #: those that failed, likewise
    missing: int  #: trials that neither finished nor failed yet
    planned: int  #: distinct trials asked for, as far as the results tell
    command: list[str]  #: the words that started the sweep
    environment: dict[str, Any]
    baseline: str = BASELINE
    verified: list[str] = field(default_factory=list)  #: other code with the same results
    left_out: dict[str, str] = field(default_factory=dict)  #: why a file is in no table
    rule: Rule | None = None  #: when comparisons are decided; None if the worlds were fixed
    labelled: Sequence[Method] = ()  #: methods with labels

    def __repr__(self) -> str:
        return f"<Results of {self.title!r}: {self.progress}>"

    @property
    def progress(self) -> str:
        """How far it has come, in words."""
        done = self.planned - len(self.failures) - self.missing
        others = {"failed": len(self.failures), "missing": self.missing}
        counts = [f"{done:,} of {self.planned:,} trials finished"]
        return ", ".join([*counts, *(f"{n:,} {what}" for what, n in others.items() if n)])

    @cached_property
    def panels(self) -> list[Panel]:
        """What is compared with one another: the methods of every setting."""
        return [panel.with_rows(self.table) for panel in self._compared]

    @cached_property
    def _compared(self) -> list[Panel]:
        failed = [failure.trial for failure in self.failures]
        return panels(self.records, self.baseline, failed, self.rule, self.labelled)

    @cached_property
    def table(self) -> pd.DataFrame:
        """A row per panel, method and offset: all intervals and tests, computed once."""
        return results_table(self._compared)

    @cached_property
    def decisions(self) -> pd.DataFrame:
        """A row per panel, method and look; none if the number of worlds was fixed before."""
        return decisions_table(self._compared)

    @cached_property
    def plans(self) -> pd.DataFrame:
        """A row per setting, method that reads plans, and signal of a plan that conflicts."""
        return plans_table(self._compared)

    @property
    def made_by(self) -> str:
        """Whose numbers these are, in a sentence; "" if only one code has made them."""
        code = str(self.environment.get("code", ""))[:12]
        return f"Made by code {code}, {'; '.join(self.verified)}." if self.verified else ""


_SHOWN = 20  # lines of a kind


def collected(sweep: Sweep, trials: dict[str, Trial], store: Store, made: Manifest) -> Results:
    """Return what the store has of these trials (by key), in their order."""
    records, failures, failed = [], [], {}
    for key, trial in trials.items():
        if (finished := store.get(key, trial)) is not None:
            records.append(finished)
        elif (reason := store.failure(key)) is not None:
            failures.append(Failure(trial=trial, reason=reason))
            failed[key] = trial
    asked = {named(trial.canonical()) for trial in trials.values()}
    ended = {*(record.key for record in records), *failed}
    missing = due(sweep, trials, records, failed.values()).keys() - ended
    return Results(
        title=sweep.title,
        records=records,
        failures=failures,
        missing=len(missing),
        planned=len(ended) + len(missing),
        command=made.command,
        environment=made.environment,
        verified=[verified.words() for verified in made.verified],
        left_out=store.rejected | dict(store.left_out(trials.keys(), asked)),
        baseline=sweep.baseline,
        rule=rule_of(sweep),
        labelled=sweep.labelled,
    )


def rule_of(sweep: Sweep) -> Rule | None:
    """Return when comparisons of a sweep are decided; None if it runs all its worlds."""
    if sweep.until_decided is None:
        return None
    pairs = [pair for panel in _planned(sweep) for pair in panel.baselines.items()]
    family = sum(label != baseline for label, baseline in pairs)
    if family == 0:
        raise InputError(
            "--until-decided has nothing to decide, as no method has a baseline to be compared "
            "with: name a second localizer, or leave it out."
        )
    if sweep.trials < FIRST:
        raise InputError(
            f"--max-worlds is {sweep.trials}, but nothing is decided before {FIRST} worlds: give "
            f"{FIRST} or more."
        )
    return Rule(margin=sweep.until_decided, family=family, worlds=sweep.trials)


def due(
    sweep: Sweep, trials: dict[str, Trial], records: Iterable[Finished], failures: Iterable[Trial]
) -> dict[str, Trial]:
    """Return those of a sweep's trials that it needs, by nothing but its results; all without rule.

    A method needs the worlds up to its decision, or to its next look; a baseline those of all that
    are compared with it.
    """
    rule = rule_of(sweep)
    if rule is None:
        return dict(trials)
    worlds: dict[tuple[Setting, Method], int] = {}
    for panel in _planned(sweep, records, failures):
        wanted = dict.fromkeys(panel.methods, FIRST)
        for pair in panel.baselines.items():
            if pair[0] != pair[1]:
                ours, reference = map(panel.runs_of, pair)
                _, needed = decide(ours, reference, panel.aim, rule)
                wanted |= {label: max(needed, wanted[label]) for label in pair}
        for label, needed in wanted.items():
            cell = panel.setting, panel.methods[label]
            worlds[cell] = max(needed, worlds.get(cell, 0))
    return {k: t for k, t in trials.items() if t.trial < worlds.get((t.setting, t.method), 0)}


def _planned(
    sweep: Sweep, records: Iterable[Finished] = (), failures: Iterable[Trial] = ()
) -> list[Panel]:
    """Return the panels of all that a sweep compares, of whatever trials there are."""
    cells = ((first.setting, first.method) for first in sweep.cells())
    return panels(records, sweep.baseline, failures, labelled=sweep.labelled, planned=cells)


def results_in(folder: Path | str) -> Results:
    """Return what a folder holds of its own sweep; nothing that it names is loaded or run."""
    folder = Path(folder)
    made = manifest.read_manifest(folder)
    sweep = recorded_sweep(folder, made)
    trials = {made.identity.key(trial): trial for trial in sweep.distinct()}
    results = collected(sweep, trials, Store(folder), made)
    if results.left_out and results.missing == results.planned:
        name, why = next(iter(results.left_out.items()))
        raise InputError(
            f"{folder} has no trial of its sweep, but {len(results.left_out)} others ({name} {why})"
            ": give another folder, or run the sweep again."
        )
    return results


def pooled(folders: Sequence[Path], command: Sequence[str]) -> Results:
    """Return what folders of the same worlds hold; a trial that several have counts once."""
    each, made = [*map(results_in, folders)], [*map(manifest.read_manifest, folders)]
    environment: dict[str, Any] = {"code": made[0].identity.code}
    failures: dict[str, Failure] = {}
    left_out: dict[str, str] = {}
    for folder, results, other in zip(folders, each, made, strict=True):
        both = made[0].identity.plug_ins.keys() & other.identity.plug_ins.keys()
        if difference := next(differences(_worlds(made[0], both), _worlds(other, both)), ""):
            raise InputError(
                f"{folder} is not comparable with {folders[0]} ({difference}): give folders of the "
                "same sweep and code that differ in their localizers or agents only."
            )
        if results.rule:
            raise InputError(
                f"{folder} is of a sweep with until_decided, whose comparisons are counted before "
                "it runs: give folders with a fixed number of worlds."
            )
        if results.missing:
            raise InputError(
                f"{folder} lacks {results.missing} of its {results.planned} trials: finish its "
                "sweep first."
            )
        environment[str(folder)] = {"command": command_line(results.command)} | results.environment
        failures |= {other.identity.key(failure.trial): failure for failure in results.failures}
        left_out |= {f"{folder}/{name}": why for name, why in results.left_out.items()}
    records = {record.key: record for results in each for record in results.records}
    drivers = [record.trial.agent for record in records.values()]
    agents = list(dict.fromkeys(agent.name for agent in drivers if agent))
    usual = len(agents) > 1 and "baseline" not in made[0].identity.sweep  # as ``Sweep`` has it
    return replace(
        each[0],
        title=", ".join(dict.fromkeys(results.title for results in each)),
        records=[*records.values()],
        failures=[failure for key, failure in failures.items() if key not in records],
        planned=len(records.keys() | failures.keys()),
        command=list(command),
        environment=environment,
        baseline=agents[0] if usual else each[0].baseline,
        verified=list(dict.fromkeys(line for results in each for line in results.verified)),
        left_out=left_out,
    )


def _worlds(made: Manifest, plug_ins: Collection[str]) -> dict[str, Any]:
    """Return what pooled folders must agree in: all but the title and what is compared."""
    free = ("title", "localizers", "agent")
    sweep = {name: value for name, value in made.identity.sweep.items() if name not in free}
    vary = sweep.get("vary", ())
    axes = [{n: v for n, v in axis.items() if not n.startswith("agent")} for axis in vary]
    digests = {name: digest for name, digest in made.identity.plug_ins.items() if name in plug_ins}
    parts = {"vary": [*filter(None, axes)], "plug-ins": digests, "code": made.identity.code}
    return sweep | parts | {"libraries": made.identity.libraries}


def recorded_sweep(folder: Path, made: Manifest) -> Sweep:
    """Return the sweep of a folder's manifest; nothing that it names is loaded."""

    def takes(name: str) -> tuple[str, ...] | None:
        if name not in made.parameters:
            raise InputError(f"parameters has no {name!r}: the manifest was changed.")
        taken = made.parameters[name]
        return None if taken is None else tuple(taken)

    with documents.errors_name(folder / manifest.MANIFEST):
        return sweep_of(overrides.of_json(made.placed), title="", takes=takes)


def left_out_lines(results: Results, out: Path) -> list[str]:
    """Say which files of a folder are in no table, and why."""
    named = (one_line(f"{out / name} {why}") for name, why in results.left_out.items())
    lines = [f"deqmcl: {sentence}; it is left out." for sentence in named]
    more = [f"deqmcl: … and {len(lines) - _SHOWN:,} more files are left out."]
    return lines if len(lines) <= _SHOWN else lines[:_SHOWN] + more


def summary(sweep: Sweep, results: Results, out: Path, files: Sequence[Path]) -> str:
    """Say how far a sweep has come, and where that is written."""
    lines = [f"{sweep.title}: {results.progress}."]
    if results.failures or results.missing:
        finished, cells = {record.trial for record in results.records}, []
        for trials in by_cell(sweep.distinct()).values():
            done = sum(trial in finished for trial in trials)
            if done < len(trials):
                cells.append(f"  {done} of {len(trials)}: {' '.join(trial_words(trials[0]))}")
        more = [f"  … and {len(cells) - _SHOWN} more"] if len(cells) > _SHOWN else []
        lines += ["Not complete:", *cells[:_SHOWN], *more]
    if equal := sweep.combinations - sweep.planned:
        lines.append(f"{equal:,} combinations equal others and were run once.")
    names = ", ".join(path.name for path in files if path.parent == out)
    return "\n".join([*lines, f"Written to {out}: {names}."])


def incomplete_sentence(results: Results) -> str:
    """Say how many trials failed, and the first reason, or how many are missing; "" if none is."""
    if not results.failures:
        lost = f"{results.missing} of {results.planned} trials are missing: run the command again."
        return lost if results.missing else ""
    first = results.failures[0]
    return (
        f"{len(results.failures)} of {results.planned} trials failed, the rest is kept; first: "
        f"{first.trial.localizer}, trial {first.trial.trial}: {first.reason}"
    )
