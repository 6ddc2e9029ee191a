"""``deqmcl replay``: a sweep over runs of localizers on one log, with tracks and its own CSV."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.console import doing, warn
from benchmarks.files import write_files
from benchmarks.replay.options import EVERY, NAME, OFTEN, Replay
from benchmarks.replay.residuals import PICTURE, TABLE, Residuals, files_of, residuals_of
from benchmarks.report.tracks import (
    accuracy,
    differences_table,
    ended,
    runs_frame,
    tables_of,
    tracks_results_csv,
    tracks_trials_csv,
)
from benchmarks.report.verdict import conclusion
from benchmarks.report.writing import load, no_report
from benchmarks.setup.logs import LogScenario
from benchmarks.setup.overrides import NOTHING, Overrides, file_names
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.results import Results
from benchmarks.sweeps.running import Options, begun, complete
from benchmarks.tables.text import file_words, percent
from benchmarks.trials.spec import Method
from benchmarks.trials.tracks import AGREE, agreement
from deqmcl_gym.envs.log import spacing
from deqmcl_gym.files import utf8
from deqmcl_gym.logs import Scanner, Trajectory
from deqmcl_gym.validation import InputError, integer
from localizers import names as localizer_names
from localizers import parameters

FEW = 0.5  # share of beams within the larger distance below which log and map do not fit
_LOOKED_AT = 200  # reference poses
_PARTICLES = "particles", "max_particles"
_TRACKS = "tracks"
_WORLDS = (
    "A world of this page is a run over the log with random numbers of its own: intervals and "
    "tests tell what other seeds would give on this log, not what other logs would."
)


def replay_sweep(
    replay: Replay,
    localizers: Sequence[str],
    *,
    particles: int | None,
    seeds: int,
    root: int,
    shared: Mapping[str, Mapping[str, Any]],
    own: Mapping[str, Mapping[str, Any]],
) -> Sweep:
    """Return the sweep whose worlds are the runs of each localizer on a log; see ``methods_of``."""
    if particles is not None:
        integer("--particles", particles, low=1)
    integer("--seeds", seeds, low=1, high=10_000)
    integer("--seed", root)
    return Sweep(
        title=f"Replay of {file_names(replay.world['log'])}",
        localizers=methods_of(localizers, particles, own, shared),
        scenario=NAME,
        lag=0,
        world=replay.world,
        assumed=replay.assumed,
        seed=root,
        trials=seeds,
        baseline=localizers[0],
        takes=own_params,
    )


def every_for(localizers: str) -> str:
    """Return how far apart records are played to localizers, named with commas, by default."""
    return OFTEN if "amcl" in map(str.strip, localizers.split(",")) else EVERY


def gated(sweep: Sweep, every: str | None) -> list[str]:
    """Return the note that ``amcl`` will update less often than on a robot; none if it will not."""
    waits = [method for method in sweep.localizers if method.name == "amcl"]
    told = {"update_min_d", "update_min_a"}
    if every is None or not waits or told & waits[0].params.keys():
        return []
    often, given = spacing("every", OFTEN, "m"), spacing("--every", every, "m")
    if given[0] <= often[0] and given[1] <= often[1]:
        return []
    return [
        "amcl updates when the robot has moved 0.25 m or turned 0.2 rad, as Nav2's does, but only "
        f"records {every} apart are played, so it may update less often than on a robot: leave out "
        f"--every, which is {OFTEN} then, or give --param amcl.update_min_d=0 --param "
        "amcl.update_min_a=0 to update at each record."
    ]


def run_replay(
    replay: Replay,
    sweep: Sweep,
    out: Path,
    options: Options,
    command: Sequence[str],
    warnings: Sequence[str],
    *,
    residuals: bool = False,
) -> str:
    """Run what is missing, write the folder; return what to print.

    Args:
        replay: what is played.
        sweep: of ``replay_sweep``, checked.
        out: folder; refused if it holds what is not of this sweep.
        options: how the runs run.
        command: the words that this was started by.
        warnings: about the log, as printed.
        residuals: whether to tell and draw where the map is wrong.

    Raises:
        TrialsFailedError: some runs failed; what the others gave is written.
    """
    with begun(sweep, out, options, command=command) as running:
        said = [*warnings, *warn([replay.sideways, disagreement(replay.scenario), touches(replay)])]
        results = running.results()
        runs = _runs(replay, sweep, results)
        said += warn([_misfit(replay, runs)])
        wrong = residuals_of(replay, runs) if residuals else None
        with doing(f"writing the report in {out}"):
            for name in (PICTURE, TABLE):  # of a run with --residuals
                (out / name).unlink(missing_ok=True)
            files = write_files(out, _contents(replay, runs, results, said, wrong))
    apart = [table for panel in results.panels if (table := differences_table(panel))]
    first, *others = tables_of(runs)
    texts = [conclusion(results), *accuracy(runs), replay.overview]
    texts += [] if wrong is None else [wrong.said]
    texts += [*(one.text("simple") for one in (first, *apart, *others)), *replay.facts]
    names = ", ".join(path.name for path in files if path.parent == out)
    texts.append(f"Written to {out}: {names} and {_TRACKS}/.")
    if (why := no_report()) is not None:
        texts.append(f"Tables only: {why}")
    return complete(results, "\n\n".join(texts))


def misfit_words(share: float, where: str, scanner: Scanner) -> str | None:
    """Return the warning for a share of beams that agree with the map; None if they are enough."""
    if math.isnan(share):
        return (
            "no beam has a measurement: every range is beyond max_range or not a number; check "
            "that ranges and max_range are in m."
        )
    if share >= FEW:
        return None
    first, last = np.degrees(scanner.bearings[[0, -1]])
    return (
        f"log and map do not fit: seen {where}, only {percent(share)} of the beams are within "
        f"{AGREE[1]} m of what the map says; check that they are of the same place and floor, the "
        f"map's resolution and origin, and the angles of the beams, {first:.0f}° to {last:.0f}°."
    )


def disagreement(played: LogScenario) -> str | None:
    """Return the warning that log and map do not fit, by the reference; None if they do."""
    log, floor_plan = played.recording()
    known = log.referenced
    if not known.size:
        return None
    part = log.of_records(known[np.unique(np.linspace(0, known.size - 1, _LOOKED_AT).astype(int))])
    assert part.reference is not None
    share = agreement(part, floor_plan, part.reference)[1]
    return misfit_words(share, "from the reference poses", log.scanner)


def touches(replay: Replay) -> str | None:
    """Return the warning that the reference itself touches walls; None if it does not."""
    log, floor_plan = replay.scenario.recording()
    if log.reference is None or not log.referenced.size:
        return None
    radius = replay.scenario.room().radius
    inside = ~floor_plan.free(log.reference[log.referenced, :2], radius)
    if not inside.any():
        return None
    return (
        f"{np.count_nonzero(inside):,} of {inside.size:,} poses of the reference touch walls of "
        f"the map, with a radius of {radius:g} {log.unit}: methods that charge collisions pay "
        "there; give the robot's --radius, or mend the map."
    )


def _misfit(replay: Replay, runs: pd.DataFrame) -> str | None:
    """Return the warning that log and map do not fit, by the best run if there is no reference."""
    shares = list(ended(runs)["agreement_03"])
    if replay.log.referenced.size or not shares:
        return None
    scanner = replay.log.scanner
    return misfit_words(max(shares), "from the poses that the best run estimates", scanner)


def _runs(replay: Replay, sweep: Sweep, results: Results) -> pd.DataFrame:
    """Return the runs of each localizer, in the order in which they were named."""
    names = [method.name for method in sweep.localizers]
    records = {
        name: [one for one in results.records if one.trial.localizer == name] for name in names
    }
    failed = [failure.trial.localizer for failure in results.failures]
    return runs_frame(records, {name: failed.count(name) for name in names}, replay.log)


def _contents(
    replay: Replay,
    runs: pd.DataFrame,
    results: Results,
    warnings: Sequence[str],
    wrong: Residuals | None,
) -> dict[str, bytes]:
    contents = {
        "results.csv": utf8(tracks_results_csv(runs, results.table)),
        "trials.csv": utf8(tracks_trials_csv(runs)),
        **_tracks(replay, runs),
    }
    if wrong is not None:
        contents |= files_of(wrong, drawn=no_report() is None)
    if no_report() is None and results.panels:
        load()
        from benchmarks.report.page import page_files
        from benchmarks.report.tables import Part

        notes = [*accuracy(runs), replay.overview, _WORLDS]
        more = [] if wrong is None else [Part(*wrong.part)]
        page = page_files(
            results, Path(), notes=notes, warnings=warnings, facts=replay.facts, more=more
        )
        contents["report.html"] = page["report.html"]
    return contents


def _tracks(replay: Replay, runs: pd.DataFrame) -> dict[str, bytes]:
    """Return the trajectories of all runs, and the reference, as TUM files by name."""
    log, files = replay.log, {}
    if log.reference is not None and log.referenced.size:
        known = log.referenced
        files[f"{_TRACKS}/reference.tum"] = Trajectory(log.times[known], log.reference[known]).tum
    labels = list(runs["label"].unique())
    words = dict(zip(labels, file_words(labels), strict=True))
    done = ended(runs)
    for label, seed, track in zip(done["label"], done["seed"], done["track"], strict=True):
        files[f"{_TRACKS}/{words[label]}-{seed}.tum"] = Trajectory(log.times, track.best).tum
    return files


def own_params(name: str) -> tuple[str, ...]:
    """Say that a localizer takes no parameter that all have: each is given its own, and no lag."""
    parameters(name)
    return ()


def methods_of(
    localizers: Sequence[str],
    particles: int | None,
    own: Mapping[str, Mapping[str, Any]],
    shared: Mapping[str, Mapping[str, Any]] = NOTHING,
) -> tuple[Method, ...]:
    """Return localizers with their parameters.

    One has those of ``shared`` by its name, else as many particles as are asked for, None: its own
    default; what is its ``own`` comes before both.
    """
    if not localizers:
        raise InputError(f"no localizer is named: allowed values: {', '.join(localizer_names())}.")
    if len(set(localizers)) < len(localizers):
        raise InputError(f"a localizer is named twice in {', '.join(localizers)}.")
    params = {
        name: {**(shared.get(name) or particles_by_name(name, particles)), **own.get(name, {})}
        for name in localizers
    }
    return tuple(Method(name, Overrides(given)) for name, given in params.items())


def particles_by_name(name: str, particles: int | None) -> Mapping[str, Any]:
    """Return the number of particles by whatever name a localizer takes it."""
    if particles is None:
        return {}
    taken = parameters(name) or ()
    given = {word: particles for word in _PARTICLES if word in taken}
    if "min_particles" in taken:
        given["min_particles"] = min(particles, 500)
    return given
