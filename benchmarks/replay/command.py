"""``deqmcl replay``: from a log and a map to the tables, the trajectories and the page."""

import contextlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.console import doing, warn
from benchmarks.execution.engines import Where, outcomes
from benchmarks.files import own_folder, write_part
from benchmarks.replay.agreement import disagreement, misfit_words, sideways
from benchmarks.replay.running import Run, attempt, guest_of
from benchmarks.replay.scoring import Played, Row, rows_of
from benchmarks.replay.setting import Setting
from benchmarks.replay.tables import plain, results_csv, trials_csv
from benchmarks.replay.verdict import comparison, tables_of, verdict
from benchmarks.replay.words import facts, overview
from benchmarks.report import load, no_report
from benchmarks.sweeps.running import TrialsFailedError, counted
from deqmcl_gym.files import utf8
from deqmcl_gym.logs import Trajectory

_TRACKS = "tracks"


def run_replay(
    setting: Setting,
    runs: Mapping[str, Run],
    out: Path,
    where: Where,
    command: Sequence[str],
    warnings: Sequence[str],
) -> str:
    """Run all, write the folder; return what to print.

    Args:
        setting: what is played.
        runs: by key.
        out: folder; refused if it holds what is not ours.
        where: where the runs run.
        command: the words that this was started by.
        warnings: about the log.

    Raises:
        TrialsFailedError: some runs failed; what the others gave is written.
    """
    own_folder(out, "replay")
    said = warn([*warnings, sideways(setting), disagreement(setting)])
    played, failures = _played(runs, out, where)
    rows = rows_of(runs, played)
    said += warn([_misfit(setting, rows)])
    failed = [f"{key}: {why}" for key, why in failures.items()]
    with doing(f"writing the report in {out}"):
        files = write_part(out, "replay", _contents(setting, rows, said, failed, command))
    referenced = bool(setting.log.referenced.size)
    texts = [*filter(None, [verdict(rows), comparison(rows)]), overview(setting)]
    texts += [plain(table) for table in tables_of(rows, referenced)]
    texts += facts(setting)
    names = ", ".join(path.name for path in files if path.parent == out)
    texts.append(f"Written to {out}: {names} and {_TRACKS}/.")
    if (why := no_report()) is not None:
        texts.append(f"Tables only: {why}")
    if failed:
        print("\n\n".join(texts))
        raise TrialsFailedError(
            f"{len(failed)} of {len(runs)} runs failed, the rest is kept; first: {failed[0]}"
        )
    return "\n\n".join(texts)


def _played(
    runs: Mapping[str, Run], out: Path, where: Where
) -> tuple[dict[str, Played], dict[str, str]]:
    """Run all; return what came to its end, and why the others did not, by key."""
    played: dict[str, Played] = {}
    failures: dict[str, str] = {}
    with (
        where.engine(runs.values(), guest_of) as engine,
        counted(out, len(runs), len(runs)) as count,
        contextlib.closing(outcomes(runs.items(), engine, attempt)) as finished,
    ):
        for key, outcome in finished:
            if outcome.record is None:
                failures[key] = outcome.reason or "no reason was given"
            else:
                found: Any = outcome.record
                played[key] = Played(run=runs[key], **found)
            count(outcome.record is None)
    return played, {key: failures[key] for key in runs if key in failures}


def _misfit(setting: Setting, rows: Sequence[Row]) -> str | None:
    """Return the warning that log and map do not fit, by the best run if there is no reference."""
    shares = [played.agreement[1] for row in rows for played in row.played]
    if setting.log.referenced.size or not shares:
        return None
    return misfit_words(max(shares), "from the poses that the best run estimates")


def _contents(
    setting: Setting,
    rows: Sequence[Row],
    warnings: Sequence[str],
    failed: Sequence[str],
    command: Sequence[str],
) -> dict[str, bytes]:
    """Return the files of the folder by name."""
    contents = {
        "results.csv": utf8(results_csv(rows)),
        "trials.csv": utf8(trials_csv(rows)),
        **_tracks(setting, rows),
    }
    if no_report() is None and any(row.played for row in rows):
        load()
        from benchmarks.replay.page import report

        contents["report.html"] = utf8(report(setting, rows, warnings, failed, command))
    return contents


def _tracks(setting: Setting, rows: Sequence[Row]) -> dict[str, bytes]:
    """Return the trajectories of all runs, and the reference, as TUM files by name."""
    log, files = setting.log, {}
    if log.referenced.size:
        assert log.reference is not None
        known = log.referenced
        files[f"{_TRACKS}/reference.tum"] = Trajectory(log.times[known], log.reference[known]).tum
    for number, row in enumerate(rows, 1):
        word = re.sub(r"[^\w.-]+", "-", row.localizer).strip("-.")
        own = word if word == row.localizer else f"{word}-{number}"
        for played in row.played:
            files[f"{_TRACKS}/{own}-{played.run.seed}.tum"] = played.track.tum
    return files
