"""One table from several folders of results, if they are of the same worlds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.report.error_tables import marked_label
from benchmarks.report.pages import fenced, page, plain, table_text
from benchmarks.report.tables import Table
from benchmarks.report.words import done
from benchmarks.setup.changes import Changes
from benchmarks.sweeps import manifest
from benchmarks.sweeps.manifest import Manifest
from benchmarks.sweeps.results import Results, results_in
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.panels import Panel
from benchmarks.tables.text import capital, estimated, fixed, percent, significant
from benchmarks.trials.spec import Method, Run, Setting
from deqmcl_gym.files import command_line
from deqmcl_gym.validation import InputError, one_line

TITLE = "Leaderboard"
NOTE = (
    "Methods of several folders of results on the same worlds, by their error e of x[t], or by the "
    "share of runs that succeed if the robot was lost, carried off or sent to a goal. Every "
    "difference is to the baseline of the method's own run, world by world, with its 95 % "
    "bootstrap interval; cost is the time per step over that baseline's, so that runs of "
    "different machines can be compared. Differences between neighbours in the list are not tested."
)
_LETTERS = 12  # of a digest
_NOT_OF_THE_WORLDS = ("title", "localizers", "limit")


@dataclass(frozen=True, kw_only=True)
class Source:
    """A folder of results, complete."""

    number: int
    folder: Path
    made: Manifest
    results: Results


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A method of a source."""

    source: Source
    panel: Panel
    of: Comparison

    @property
    def digest(self) -> str:
        """Digest of the code that made it, and of its own code if it is a plug-in."""
        made = self.source.made.made
        own = made.plug_ins.get(self.of.method.name)
        return made.code[:_LETTERS] + (f" + {own[:_LETTERS]}" if own else "")


def sources(folders: Sequence[Path]) -> list[Source]:
    """Read folders that may stand in one table.

    Raises:
        InputError: one is given twice, is no folder of results, is incomplete, or has other worlds
            than the first; the message names it and the differences.
    """
    for place, folder in enumerate(folders):
        if folder.resolve() in {one.resolve() for one in folders[:place]}:
            raise InputError(f"{folder} is given twice: name each folder once.")
    read = [
        Source(number=n, folder=one, made=manifest.read(one), results=results_in(one))
        for n, one in enumerate(folders, 1)
    ]
    for source in read:
        _refuse_incomplete(source)
    first, *others = read
    for other in others:
        _refuse_other_worlds(first, other)
    return read


def boards(read: Sequence[Source]) -> list[Table]:
    """Return a table for each setting; what several runs have of one code is listed once."""
    found: dict[tuple[Setting, Changes], dict[tuple[object, str], list[Entry]]] = {}
    titles: dict[tuple[Setting, Changes], str] = {}
    for source in read:
        for panel in source.results.panels:
            place = (panel.setting, panel.swept)
            titles.setdefault(place, panel.title)
            for one in panel.present:
                row = Entry(source=source, panel=panel, of=one)
                found.setdefault(place, {}).setdefault((one.method, row.digest), []).append(row)
    return [_board(titles[place], list(same.values())) for place, same in found.items()]


def leaderboard_files(read: Sequence[Source], command: Sequence[str]) -> dict[str, bytes]:
    """Return leaderboard.html and leaderboard.md, by name."""
    tables, runs, said = boards(read), _runs(read), command_line(command)
    parts = [f"# {TITLE}", plain(NOTE), *(table_text("", one) for one in (*tables, runs))]
    html = page(
        "report/leaderboard.html.jinja",
        title=TITLE,
        note=NOTE,
        boards=tables,
        runs=runs,
        command=said,
    )
    text = "\n\n".join([*parts, "Made by:", fenced(said)]) + "\n"
    return {"leaderboard.html": html.encode(), "leaderboard.md": text.encode()}


def _board(title: str, methods: list[list[Entry]]) -> Table:
    """Rank methods, each given as its rows in all runs that have it."""
    panel = methods[0][0].panel
    methods.sort(key=lambda same: same[0].of.worse)
    rows = [same[0] for same in methods]
    values = [row.of.worse for row in rows]
    ranked_by = f"{done(panel.aim)}, %" if panel.aim else f"error e, {panel.unit} (SD)"
    header = ["method", ranked_by, "difference to the baseline, 95 % interval"]
    header += [*([] if panel.aim else ["wins"]), "cost (baseline = 1)", "worlds", "code", "run"]
    lines = [
        [
            f"{1 + values.index(value)}. {marked_label(row.panel, row.of)}",
            *_compared(row.of),
            f"{significant(row.of.cost, 2)} ×",
            str(row.of.worlds),
            row.digest,
            ", ".join(str(one.source.number) for one in same),
        ]
        for value, row, same in zip(values, rows, methods, strict=True)
    ]
    strong = [(line, column) for line in range(values.count(values[0])) for column in (0, 1)]
    return Table(f"{capital(title)}.", header, lines, strong=strong)


def _compared(row: Comparison) -> list[str]:
    """The error, its difference to the baseline's and the wins; else the share, its difference."""
    if row.aim is not None:
        diff = "baseline" if row.is_baseline else estimated(row.standing.diff.percent, "+.0f")
        return [estimated(row.standing.value.percent, ".0f"), diff]
    value = f"{fixed(row.error.mean)} ({fixed(row.error_sd)})"
    if row.is_baseline:
        return [value, "baseline", "–"]
    return [value, estimated(row.diff, "+.2f"), percent(row.win_rate)]


def _runs(read: Sequence[Source]) -> Table:
    lines = []
    for source in read:
        made = source.made
        ours = {"deqmcl-gym": made.environment.get("deqmcl-gym", "")}
        versions = ours | dict(made.made.libraries)
        lines.append(
            [
                str(source.number),
                one_line(source.folder.name),
                command_line(made.command),
                ", ".join(f"{name} {number}" for name, number in versions.items()),
                "; ".join([made.made.code, *source.results.verified]),
            ]
        )
    header = ["run", "folder", "command", "versions", "code (SHA-256)"]
    return Table(
        "What made the numbers: the command, versions and digest of every run.",
        header,
        lines,
        words=True,
    )


def _refuse_incomplete(source: Source) -> None:
    results = source.results
    if results.missing or results.failures:
        raise InputError(
            f"{source.folder} has {results.missing} trials that were not run and "
            f"{len(results.failures)} that failed, of {results.planned}: finish its sweep first."
        )
    if not any(record.trial.method.is_named(results.baseline) for record in results.records):
        raise InputError(
            f"{source.folder} has no trial of the baseline {results.baseline}, by which folders "
            "are compared: run the sweep with it."
        )


def _refuse_other_worlds(first: Source, other: Source) -> None:
    ours, theirs = (
        {name: v for name, v in one.made.sweep.items() if name not in _NOT_OF_THE_WORLDS}
        for one in (first, other)
    )
    if apart := list(manifest.differences(ours, theirs)):
        raise InputError(
            f"{other.folder} is not comparable with {first.folder} ({'; '.join(apart)}): give "
            "folders of one sweep that differ in their localizers only."
        )
    known, found = _of_baseline(first), _of_baseline(other)
    if known.keys() != found.keys():
        of, now = (
            " and ".join(dict.fromkeys(str(method) for _, method, _ in one))
            for one in (known, found)
        )
        raise InputError(
            f"{other.folder} is not comparable with {first.folder}: its baseline is {now}, but "
            f"must be {of}; give both sweeps one baseline with the same parameters."
        )
    for place, scores in known.items():
        if found[place] != scores:
            raise InputError(
                f"{other.folder} is not comparable with {first.folder}: the baseline "
                f"{first.results.baseline} has other scores on world {place[2][0]}, so the worlds "
                "or the baseline are not the same; run both sweeps with one version of the code."
            )


def _of_baseline(source: Source) -> dict[tuple[Setting, Method, Run], object]:
    """Its baseline's scores by setting, method, and world with filter seed."""
    return {
        (record.trial.setting, record.trial.method, record.trial.run): record.scores
        for record in source.results.records
        if record.trial.method.is_named(source.results.baseline)
    }
