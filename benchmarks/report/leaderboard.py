"""One ranking from several folders of results of the same worlds, and their held-out runs."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.report.error_tables import marked_label
from benchmarks.report.pages import fenced, page, plain, table_text
from benchmarks.report.tables import Table
from benchmarks.report.words import done
from benchmarks.setup.changes import Changes
from benchmarks.sweeps import manifest
from benchmarks.sweeps.held_out import placeless
from benchmarks.sweeps.submissions import Handed, seed_fault
from benchmarks.tables import stats
from benchmarks.tables.comparison import Comparison
from benchmarks.tables.pairing import Runs, differences, runs_of
from benchmarks.tables.panels import Panel
from benchmarks.tables.stats import UNKNOWN, Estimate
from benchmarks.tables.text import capital, csv_text, estimated, short_name, significant
from benchmarks.trials.spec import Method, Run, Setting
from deqmcl_gym.files import command_line
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, one_line

TITLE = "Leaderboard"
NOTES = {
    "public": "on the worlds of the suite, which everybody knows and can tune to.",
    "held-out": "on worlds of a seed that nobody chose: it follows from the submission and from a "
    "public value that came later. Each submission has its own; a method of several stands with "
    "those of the first.",
    "to the baseline": "difference to the baseline of the same run, world by world.",
    "gap": "that difference on held-out worlds less that on public ones; the worlds are two "
    "samples, so its interval is that of an unpaired difference. A method that was tuned to the "
    "public worlds is worse on others.",
    "cost": "time per step over the baseline's in the same run, as it was handed in.",
    "label": "reported: nothing was run again. re-run: a sample of the trials was run again by "
    "whoever made this page, and agrees to the last digit. re-run held-out: beside that, the seed "
    "was derived again, and the public value looked up.",
    "rank": "first methods with held-out runs, by the baseline's public score plus the difference "
    "to it on held-out worlds; then the others, by their public score. Neighbours in the list are "
    "not tested.",
}
_LETTERS = 12  # of a digest
_NOT_OF_THE_WORLDS = ("title", "localizers", "limit")
_NOT_OF_THE_METHOD = ("seed", "trial", "filter_seed")


@dataclass(frozen=True, kw_only=True)
class Scored:
    """What a run says of a method.

    Attributes:
        handed: the run.
        panel: of the method.
        of: it, beside its baseline.
    """

    handed: Handed
    panel: Panel
    of: Comparison

    @property
    def digest(self) -> str:
        """Digest of the code that made it, and those of localizer and agent that are plug-ins."""
        made, method = self.handed.made.made, self.of.method
        names = [method.name, *([method.agent.name] if method.agent else [])]
        own = (made.plug_ins[name] for name in names if name in made.plug_ins)
        return " + ".join(digest[:_LETTERS] for digest in (made.code, *own))

    @property
    def apart(self) -> Floats:
        """Its score less its baseline's in each world, (W,)."""
        return differences(self._runs(self.of.method), self._runs(self.of.baseline))

    @property
    def base(self) -> Comparison:
        """Its baseline."""
        return self.panel.baseline_of(self.of)

    def _runs(self, method: Method) -> Runs:
        if self.panel.aim is None:
            return runs_of(self.panel.records[method], "error")
        return self.panel.whole[method].runs(self.panel.aim)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A method on a board.

    Attributes:
        public: its scores on the suite's worlds, of all runs that have it: they are the same.
        held: on held-out worlds; None: there is no such run.
    """

    public: Sequence[Scored]
    held: Scored | None = None

    @property
    def first(self) -> Scored:
        """Its public score."""
        return self.public[0]

    @property
    def rank(self) -> tuple[bool, float]:
        """What it is ranked by, the least first; see ``NOTES``."""
        if self.held is None:
            return True, self.first.of.worse
        worse = self.first.base.worse + (self.held.of.worse - self.held.base.worse)
        return False, math.inf if math.isnan(worse) else worse

    @property
    def gap(self) -> Estimate:
        """Its difference to the baseline on held-out worlds less that on public ones."""
        if self.held is None or self.first.of.is_baseline:
            return UNKNOWN
        return stats.unpaired(self.held.apart, self.first.apart)

    @property
    def label(self) -> str:
        """How its numbers are known: see ``Handed.label``."""
        known = [one.handed.label for one in self.public]
        if "re-run" not in known:
            return "reported"
        return "re-run" if self.held is None else self.held.handed.label

    @property
    def runs(self) -> str:
        """The numbers of its runs."""
        known = [*self.public, *([self.held] if self.held else [])]
        return ", ".join(str(one.handed.number) for one in known)


@dataclass(frozen=True, kw_only=True)
class Board:
    """The methods of a setting, ranked."""

    title: str
    entries: Sequence[Entry]

    def table(self) -> Table:
        """Return it in words."""
        first = self.entries[0].first.panel
        score = f"{done(first.aim)}, %" if first.aim else f"error e, {first.unit}"
        apart = "to the baseline, points" if first.aim else "to the baseline"
        header = ["method", f"public: {score}", f"public, {apart}"]
        header += ["held-out", f"held-out, {apart}", "gap"]
        header += ["cost (baseline = 1)", "label", "run"]
        ranks = [entry.rank for entry in self.entries]
        lines = [
            [
                f"{1 + ranks.index(entry.rank)}. {marked_label(entry.first.panel, entry.first.of)}",
                *_cells(entry.first),
                *(_cells(entry.held) if entry.held else ("–", "–")),
                _said(entry.gap, entry.first, "+") if entry.gap is not UNKNOWN else "–",
                f"{significant(entry.first.of.cost, 2)} ×",
                entry.label,
                entry.runs,
            ]
            for entry in self.entries
        ]
        best = [line for line, rank in enumerate(ranks) if rank == ranks[0]]
        columns = 0, 3 if self.entries[0].held else 1
        strong = [(line, column) for line in best for column in columns]
        return Table(f"{capital(self.title)}.", header, lines, strong=strong)


def boards(read: Sequence[Handed]) -> list[Board]:
    """Return a board for each setting; what several runs have of one code is listed once.

    Raises:
        InputError: the folders are not comparable: one is incomplete, has other worlds than the
            first, or is a held-out run without its public one; the message says how they differ.
    """
    for one in read:
        _refuse_incomplete(one)
        for fault in seed_fault(one):
            raise InputError(f"{one.folder}: {fault}")
    public = [one for one in read if one.held_out is None]
    held = _held_out(read, public)
    for other in public[1:]:
        _refuse_other_worlds(public[0], other)
    scores = {one.digest: dict(_scores(own)) for one in public if (own := held.get(one.digest))}
    found: dict[tuple[Setting, Changes], dict[tuple[str, str], list[Scored]]] = {}
    titles: dict[tuple[Setting, Changes], str] = {}
    for handed in public:
        for key, scored in _scores(handed):
            place = (scored.panel.setting, scored.panel.swept)
            titles.setdefault(place, scored.panel.title)
            found.setdefault(place, {}).setdefault((key, scored.digest), []).append(scored)
    return [
        Board(
            title=titles[place],
            entries=sorted(
                (
                    Entry(public=same, held=_of_any(scores, same, key))
                    for (key, _), same in methods.items()
                ),
                key=lambda entry: entry.rank,
            ),
        )
        for place, methods in found.items()
    ]


def leaderboard_files(read: Sequence[Handed], command: Sequence[str]) -> dict[str, bytes]:
    """Return leaderboard.html, leaderboard.md and leaderboard.csv, by name."""
    ranked = boards(read)
    tables, runs, said = [own.table() for own in ranked], _runs_table(read), command_line(command)
    notes = "\n".join(f"- **{term}**: {plain(words)}" for term, words in NOTES.items())
    parts = [f"# {TITLE}", *(table_text("", one) for one in tables), notes, table_text("", runs)]
    html = page(
        "report/leaderboard.html.jinja",
        title=TITLE,
        notes=NOTES,
        boards=tables,
        runs=runs,
        command=said,
    )
    text = "\n\n".join([*parts, "Made by:", fenced(said)]) + "\n"
    files = {"leaderboard.html": html, "leaderboard.md": text, "leaderboard.csv": board_csv(ranked)}
    return {name: content.encode() for name, content in files.items()}


def board_csv(ranked: Sequence[Board]) -> str:
    """Return a line per board and method; shares are of 1."""
    ends = ("", "_low", "_high")
    estimates = ("public", "public_diff", "held_out", "held_out_diff", "gap")
    head = ["setting", "scenario", "score", "unit", "rank", "method", "params", "baseline"]
    head += [f"{name}{end}" for name in estimates for end in ends]
    head += ["cost", "label", "worlds", "held_out_worlds", "code", "runs"]
    return csv_text(head, (line for board in ranked for line in _csv_lines(board)))


def _csv_lines(board: Board) -> Iterator[list[object]]:
    ranks = [entry.rank for entry in board.entries]
    for entry in board.entries:
        first, held = entry.first, entry.held
        of, aim = first.of, first.panel.aim
        known = [of.standing.value, of.standing.diff]
        known += [held.of.standing.value, held.of.standing.diff] if held else [UNKNOWN, UNKNOWN]
        yield [
            *(board.title, short_name(first.panel.setting.scenario)),
            *(("error", first.panel.unit) if aim is None else (aim.name, "share")),
            *(1 + ranks.index(entry.rank), first.panel.labels[of.method]),
            *(json.dumps(of.method.params.json()), first.panel.labels[of.baseline]),
            *(value for one in (*known, entry.gap) for value in one),
            *(float(f"{of.cost:.4g}"), entry.label, of.worlds, held.of.worlds if held else None),
            *(first.digest, entry.runs),
        ]


def _cells(own: Scored) -> tuple[str, str]:
    """A score and its difference to the baseline's."""
    value = _said(own.of.standing.value, own)
    return value, "baseline" if own.of.is_baseline else _said(own.of.standing.diff, own, "+")


def _said(value: Estimate, own: Scored, sign: str = "") -> str:
    """An error with two digits, or a share in per cent."""
    if own.panel.aim is not None:
        return estimated(value.percent, f"{sign}.0f")
    return estimated(value, f"{sign}.2f")


def _runs_table(read: Sequence[Handed]) -> Table:
    lines = []
    for one in read:
        made, held = one.made, one.held_out
        ours = {"deqmcl-gym": made.environment.get("deqmcl-gym", "")}
        versions = ours | dict(made.made.libraries)
        lines.append(
            [
                str(one.number),
                one_line(one.folder.name),
                command_line(made.command),
                f"{held.value} ({held.origin})" if held else "–",
                one.known_by,
                ", ".join(f"{name} {number}" for name, number in versions.items()),
                "; ".join([made.made.code, *one.results.verified]),
                one.digest,
            ]
        )
    header = ["run", "folder", "command", "public value", "known by", "versions", "code (SHA-256)"]
    return Table(
        "What made the numbers, and how they are known. A public value and its date are to be "
        "looked up: it must have come after the submission.",
        [*header, "submission (SHA-256)"],
        lines,
        words=True,
    )


def _scores(handed: Handed) -> Iterator[tuple[str, Scored]]:
    """Yield the methods of a run, each with what it is called wherever its files are."""
    for panel in handed.results.panels:
        for of in panel.present:
            said = panel.records[of.method][0].trial.canonical() | {"swept": panel.swept.json()}
            plain = {key: value for key, value in said.items() if key not in _NOT_OF_THE_METHOD}
            key = json.dumps(placeless(plain, handed.made.made), sort_keys=True)
            yield key, Scored(handed=handed, panel=panel, of=of)


def _of_any(
    scores: Mapping[str, Mapping[str, Scored]], public: Sequence[Scored], key: str
) -> Scored | None:
    """Return the first held-out score of a method that one of its submissions has."""
    own = (scores.get(one.handed.digest, {}).get(key) for one in public)
    return next(filter(None, own), None)


def _held_out(read: Sequence[Handed], public: Sequence[Handed]) -> dict[str, Handed]:
    """Return held-out runs by the digest of their submission."""
    found: dict[str, Handed] = {}
    for one in read:
        if one.held_out is None:
            continue
        if one.digest in found:
            raise InputError(
                f"{found[one.digest].folder} and {one.folder} are held-out runs of one submission: "
                "give the one whose value was named when it was handed in."
            )
        found[one.digest] = one
        if one.digest not in {own.digest for own in public}:
            raise InputError(
                f"{one.folder} is the held-out run of a submission that no other folder has a "
                "public run of: give its public run too, of the same code and methods."
            )
    return found


def _refuse_incomplete(one: Handed) -> None:
    results = one.results
    if results.missing or results.failures:
        raise InputError(
            f"{one.folder} has {results.missing} trials that were not run and "
            f"{len(results.failures)} that failed, of {results.planned}: finish its sweep first."
        )
    if not any(record.trial.method.is_named(results.baseline) for record in results.records):
        raise InputError(
            f"{one.folder} has no trial of the baseline {results.baseline}, by which folders "
            "are compared: run the sweep with it."
        )


def _refuse_other_worlds(first: Handed, other: Handed) -> None:
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


def _of_baseline(one: Handed) -> dict[tuple[Setting, Method, Run], object]:
    """Its baseline's scores by setting, method, and world with filter seed."""
    return {
        (record.trial.setting, record.trial.method, record.trial.run): record.scores
        for record in one.results.records
        if record.trial.method.is_named(one.results.baseline)
    }
