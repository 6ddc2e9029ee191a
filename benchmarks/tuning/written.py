"""What ``deqmcl tune`` writes: the best parameters, the held-out gain, what mattered, a picture."""

import json
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.files import write_files
from benchmarks.replay.nav2 import nav2_document
from benchmarks.report.writing import load, no_report
from benchmarks.setup.changes import NOTHING, Changes, file_names
from benchmarks.tables.frames import milliseconds_per_step
from benchmarks.tables.stats import Estimate, estimate
from benchmarks.tables.text import csv_text, estimated, fixed, percent, significant
from benchmarks.trials.scores import TRACK_SCORES, Score
from benchmarks.trials.scoring import Finished
from benchmarks.tuning.search import RUNS, Found, Tried
from benchmarks.tuning.space import Choice, Range
from benchmarks.tuning.task import GOALS, Task, value_of
from deqmcl_gym.files import command_line, utf8
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError

NAV2 = "nav2.yaml"
_SHUFFLES = 1000  # of the ranks, for what chance would give
_BINS = 4  # of a range
_FEW = 20  # candidates below which importance says nothing
_SURE, _FALLEN = 0.9, 0.05  # share inside the 95 % region below which, and fall that, is told
_LEAST = 6  # segments: of fewer, a sign test could not tell any difference from chance (p < 0.05)
_COVERAGE = TRACK_SCORES["coverage_95"]
_TABLE = (*(GOALS[name] for name in ("median", "p95", "localized")), _COVERAGE)


def write(
    found: Found, out: Path, words: Sequence[str], nav2: Path | None, node: str | None
) -> str:
    """Write the folder of a search; return what to print.

    Args:
        found: what came of it.
        out: the folder.
        words: of the command.
        nav2, node: the user's parameter file of Nav2, whose other nodes and names are kept.
    """
    goal = found.task.goal
    rows = _segments(found, goal)
    said = f"{verdict(found, rows)}{_too_sure(found)}"
    best, why_not = _nav2(found.task, found.best, nav2, node)
    table, weights = _table(found), _importance(found)
    text = "\n\n".join(
        [
            f"# {found.task.localizer}, tuned",
            said,
            table,
            "## Best parameters",
            _changed(found),
            "## Which parameters mattered",
            weights,
            "## How this was made",
            _made(found, words),
        ]
    )
    contents = {
        "best.toml": utf8(_sweep_file(found, words)),
        "tuned.md": utf8(text + "\n"),
        "tuned.csv": utf8(csv_text(_COLUMNS, rows)),
        "candidates.csv": utf8(_candidates(found)),
    }
    if best is not None:
        contents[NAV2] = utf8(best)
    drawn = no_report()
    if drawn is None:
        load()
        contents["trade-off.png"] = _trade_off(found)
    files = write_files(out, contents)
    texts = [said, table, _changed(found), weights, why_not]
    texts.append(f"Written to {out}: {', '.join(path.name for path in files)}.")
    texts.append("" if drawn is None else f"No picture: {drawn}")
    return "\n\n".join(filter(None, texts))


_COLUMNS = ("log", "begins_s", "metres", "runs", "default", "tuned", "difference")


def _segments(found: Found, goal: Score) -> list[list[Any]]:
    """Return a line per held-out segment; those where a run failed have no numbers."""
    lines = []
    each = zip(found.task.held_out, found.default_runs, found.best_runs, strict=True)
    for segment, default, best in each:
        before, after = (_mean(goal, own) for own in (default, best))
        log = file_names(segment.world["log"])
        begins, metres = round(segment.begins, 2), round(segment.metres, 2)
        lines.append([log, begins, metres, RUNS, before, after, after - before])
    return lines


def _mean(goal: Score, records: Sequence[Finished]) -> float:
    values = [value_of(goal, record) for record in records]
    return float(np.mean(values)) if len(values) == RUNS else math.nan


def verdict(found: Found, rows: Sequence[Sequence[Any]]) -> str:
    """Say the held-out result of default and winner, paired, in a few sentences."""
    goal, limit = found.task.goal, found.task.max_ms
    pairs = np.array([row[4:6] for row in rows], np.float64)
    known = pairs[~np.isnan(pairs).any(axis=1)]
    left_out = _left_out(found, len(pairs) - len(known))
    on = f"on {len(known)} held-out segments, {RUNS} runs each"
    slow = ""
    if limit is not None and not found.best.ms <= limit:
        slow = f"Nothing that was tried keeps to {limit:g} ms per step; this is the best of all. "
    if not len(known):
        return f"{slow}No held-out segment could be compared.{left_out}"
    before, after = known.mean(axis=0)
    if found.best.values == NOTHING:
        which = "candidate" if limit is None or slow else f"candidate of at most {limit:g} ms"
        return (
            f"{slow}No gain: no {which} was better than the default on the training segments. The "
            f"default's {goal.words} {on}: {_number(goal, before)}.{left_out}"
        )
    off = known[:, 1] - known[:, 0]
    better = int((found.task.goal.sign * off < 0).sum())
    gain = estimate(off) if len(off) >= _LEAST else Estimate(float(off.mean()))
    said = (
        f"{goal.words[:1].upper()}{goal.words[1:]} {on}: {_number(goal, before, bare=True)} → "
        f"{_number(goal, after)}, {better} of {len(known)} segments better; difference "
        f"{_difference(goal, gain)}."
    )
    return f"{slow}{said} {_conclusion(found, gain)}{left_out}"


def _too_sure(found: Found) -> str:
    """Warn that the winner's region holds less of the reference than the default's."""
    before, after = (_mean_of(_COVERAGE, runs) for runs in (found.default_runs, found.best_runs))
    if not (after < _SURE and after < before - _FALLEN):
        return ""
    return (
        f" Warning: the 95 % region of the tuned parameters holds {percent(after, 1)} of the "
        f"reference, that of the default {percent(before, 1)}: do not trust their covariance, or "
        "tune by --score log-score, which looks at it, too."
    )


def _mean_of(goal: Score, runs: Sequence[Sequence[Finished]]) -> float:
    """Return the mean of a score over all runs on all segments."""
    values = [value_of(goal, record) for own in runs for record in own]
    return float(np.mean(values)) if values else math.nan


def _failed(runs: Sequence[Sequence[Finished]]) -> int:
    """Return on how many segments a run failed."""
    return sum(len(own) < RUNS for own in runs)


def _left_out(found: Found, count: int) -> str:
    """Say how many segments cannot be compared, and whose runs failed there."""
    if not count:
        return ""
    default, tuned = _failed(found.default_runs), _failed(found.best_runs)
    whose = f"those of the default on {default}, those of the tuned parameters on {tuned}"
    if found.best.values == NOTHING:
        whose = f"those of the default on {default}"
    return f" Segments left out, as a run failed there: {count} ({whose})."


def _conclusion(found: Found, gain: Estimate) -> str:
    limit, slow = found.task.max_ms, found.tried[0].ms
    if math.isnan(gain.low):
        return f"Fewer than {_LEAST} segments are too few for an interval: a gain is not shown."
    each = zip(found.default_runs, found.best_runs, strict=True)
    if any(len(tuned) < RUNS <= len(default) for default, tuned in each):
        return "The tuned parameters fail where the default does not: a gain is not shown."
    if not (gain.low > 0 or gain.high < 0):
        return "The 95 % interval includes 0: a gain is not shown."
    if found.task.goal.sign * gain.mean < 0:
        return "The 95 % interval excludes 0."
    worse = "The tuned parameters are worse on held-out segments"
    if limit is not None and not slow <= limit:
        return f"{worse}, but the default takes more than {limit:g} ms per step."
    return f"{worse}: keep the default."


def _number(goal: Score, value: float, *, bare: bool = False) -> str:
    if goal.unit == "share":
        return f"{100 * value:.1f}{'' if bare else ' %'}"
    if goal.unit == "nats":
        return f"{value:,.2f}{'' if bare else ' nats'}"
    return f"{value:.3f}{'' if bare else ' m'}"


def _difference(goal: Score, gain: Estimate) -> str:
    if goal.unit == "share":
        return estimated(gain.percent, "+.1f", " points")
    if goal.unit == "nats":
        return estimated(gain, "+,.2f", " nats")
    return estimated(gain, "+.3f", " m")


def _table(found: Found) -> str:
    lines = [
        "| held-out | median error | 95 % | within 1 m, 30° | inside 95 % region | ms per step |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    rows = {"default": found.default_runs, "tuned": found.best_runs}
    for name, runs in rows.items():
        records = [record for own in runs for record in own]
        if records:
            median, p95, near, inside = (_mean_of(score, runs) for score in _TABLE)
            ms = milliseconds_per_step(records)
            lines.append(
                f"| {name} | {median:.3f} m | {p95:.3f} m | {percent(near, 1)} | "
                f"{percent(inside, 1)} | {fixed(ms)} |"
            )
    return "\n".join(lines)


def _changed(found: Found) -> str:
    """Return the values of the winner beside those of the default."""
    task = found.task
    if found.best.values == NOTHING:
        return "The default; no value is changed."
    lines = ["| parameter | default | tuned |", "|---|---:|---:|"]
    for name in task.space:
        if name in found.best.values:
            before = task.usual.get(name)
            word = "its own" if before is None else _word(before)
            lines.append(f"| `{name}` | {word} | {_word(found.best.values[name])} |")
    return "\n".join(lines)


def _word(value: Any) -> str:
    return significant(value) if isinstance(value, float) else str(value)


def importance(space: Mapping[str, Range | Choice], tried: Sequence[Tried]) -> dict[str, Any]:
    """Return by parameter: share of the variance of ranks that it explains alone, and where.

    The ranks are those of the candidates drawn from the whole space, in the first rung of their
    round. A range is cut into four at the quartiles of what was drawn, one with four values or
    fewer into these. The share is ε², the
    correlation ratio η² less what as many groups would explain by chance (Kelley 1935): the main
    effects of a functional ANOVA.

    Returns:
        (ε², its 95 % quantile over shuffled ranks, the best group in words) by name.
    """
    free = [one for one in tried if one.free]
    ranks = np.array([one.rank for one in free])
    rng = np.random.default_rng(0)
    shuffled = rng.permuted(np.tile(ranks, (_SHUFFLES, 1)), axis=1)
    found = {}
    for name, one in space.items():
        values = [own.values[name] for own in free]
        kinds = list(dict.fromkeys(values))
        if isinstance(one, Choice) or len(kinds) <= _BINS:
            groups = np.array([kinds.index(value) for value in values])
            words = [str(kind) for kind in kinds]
        else:
            numbers = np.array(values, np.float64)
            edges = np.unique(np.quantile(numbers, np.linspace(0, 1, _BINS + 1)))
            groups = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, len(edges) - 2)
            words = [f"{significant(a)} to {significant(b)}" for a, b in pairwise(edges)]
        means = [ranks[groups == i].mean() if (groups == i).any() else 2 for i in range(len(words))]
        chance = float(np.quantile(_explained(shuffled, groups), 0.95))
        share = float(_explained(ranks[None], groups)[0])
        found[name] = share, chance, words[int(np.argmin(means))]
    return found


def _explained(ranks: Floats, groups: Any) -> Floats:
    """Return ε² of rows of ranks, (m, n), in groups, (n,)."""
    n, kinds = ranks.shape[1], np.unique(groups)
    whole = ((ranks - ranks.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    within = np.zeros(len(ranks))
    for kind in kinds:
        own = ranks[:, groups == kind]
        within += ((own - own.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    if n <= len(kinds):
        return np.zeros(len(ranks))
    return np.asarray(1 - (within / (n - len(kinds))) / (whole / (n - 1)))


def _importance(found: Found) -> str:
    free = sum(one.free for one in found.tried)
    if free < _FEW:
        return f"{free} candidates from the whole space are too few to say; it takes {_FEW}."
    weights = importance(found.task.space, found.tried)
    listed = sorted(weights.items(), key=lambda item: -item[1][0])
    lines = ["| parameter | explains | best |", "|---|---:|---|"]
    lines += [
        f"| `{name}` | {percent(share)} | {best} |"
        for name, (share, chance, best) in listed
        if share > chance
    ]
    rest = [f"`{name}`" for name, (share, chance, _) in listed if share <= chance]
    said = (
        f"Share of the variance of ranks among {free} candidates drawn from the whole space that "
        "a parameter explains alone (ε² over four parts of its range, or over its values if it has "
        "four or fewer)."
    )
    chance_words = f"Not more than chance: {', '.join(rest)}." if rest else ""
    table = "\n".join(lines) if len(lines) > 2 else ""
    return "\n\n".join(filter(None, [said, table, chance_words]))


def _made(found: Found, words: Sequence[str]) -> str:
    task, train, held = found.task, found.task.training, found.task.held_out
    metres = float(np.mean([one.metres for one in task.segments]))
    limit = "" if task.max_ms is None else f" At most {task.max_ms:g} ms per step were allowed."
    return (
        f"    {command_line(words)}\n\n"
        f"{len(found.tried)} candidates in {found.rounds} rounds; `--candidates "
        f"{len(found.tried)}` instead of a budget gives the same candidates. Segments of "
        f"{metres:.0f} m: {len(train)} trained on, {len(held)} held out, in turn; the search does "
        f"not see the latter.{limit} Winner on the training segments: {found.best.value:.4g}, "
        f"default {found.tried[0].value:.4g}; these two are what was searched for, so their "
        "difference is too good. Intervals: bootstrap over segments, which are of the same "
        "building; they do not tell of another one."
    )


def _candidates(found: Found) -> str:
    names = list(found.task.space)
    lines = [
        [i, one.round, int(one.free), one.rank, one.segments, one.value, one.ms]
        + [one.values.get(name) for name in names]
        for i, one in enumerate(found.tried)
    ]
    header = ["candidate", "round", "whole_space", "rank", "segments", "value", "ms_per_step"]
    return csv_text([*header, *names], lines)


def _sweep_file(found: Found, words: Sequence[str]) -> str:
    """Return the winner as a sweep file over the first log."""
    task, segment = found.task, found.task.segments[0]
    params, assumed = task.parts(found.best.values)
    if (lag := task.usual.get("lag")) is not None:
        params = Changes({"lag": lag}) | params
    own = {n: v for n, v in segment.assumed.items() if not n.startswith("prior.")}
    lines = [
        f"# {' '.join(command_line(words).split())}",
        'scenario = "replay"',
        "lag = 0",
        "",
        "[world]",
        *(f"{name} = {_toml(value)}" for name, value in segment.whole.items()),
        "",
        "[assumed]",
        *(f"{name} = {_toml(value)}" for name, value in {**own, **assumed}.items()),
        "",
        "[[localizers]]",
        f"name = {_toml(task.localizer)}",
        *(f"params.{name} = {_toml(value)}" for name, value in params.items()),
    ]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value, ensure_ascii=False)


def _nav2(task: Task, best: Tried, path: Path | None, node: str | None) -> tuple[str | None, str]:
    """Return nav2.yaml, or None and why there is none."""
    if task.localizer != "amcl":
        return None, f"No {NAV2}: {task.localizer} is not a filter of Nav2."
    try:
        document = nav2_document(task.parts(best.values)[0], path, node)
    except InputError as error:
        return None, f"No {NAV2}: {error}"
    return yaml.safe_dump(document, sort_keys=False), ""


def _trade_off(found: Found) -> bytes:
    """Return the picture of score and time of all candidates on all training segments."""
    from matplotlib.ticker import LogLocator, NullLocator

    from benchmarks.pictures import styled
    from benchmarks.report.charts import STYLE, Chart, canvas

    goal, last = found.task.goal, len(found.task.training)
    factor, unit = (100, "%") if goal.unit == "share" else (1, goal.unit)
    known = [one for one in found.tried if math.isfinite(one.value) and one.ms > 0]
    parts = {
        "dropped on fewer segments": ([o for o in known if o.segments < last], "0.6", 12),
        "on all training segments": ([o for o in known if o.segments == last], "C0", 24),
        "default": ([o for o in known if o.values == NOTHING], "C3", 70),
        "winner": ([o for o in known if o is found.best], "C2", 70),
    }
    with styled(STYLE):
        axes = canvas(6.4, 3.8)
        for label, (own, color, size) in parts.items():
            x, y = [one.ms for one in own], [factor * one.value for one in own]
            axes.scatter(x, y, s=size, c=color, label=label, linewidths=0)
        axes.set_xscale("log")
        if in_metres := goal.unit == "m" and all(one.value > 0 for one in known):
            axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis)[: 1 + in_metres]:
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_minor_locator(NullLocator())
            axis.set_major_formatter("{x:g}")
        if goal.unit == "nats":  # those of a filter that is lost and sure are huge
            axes.set_yscale("symlog", linthresh=10)
        words = goal.words.replace("share of records ", "")
        axes.set(xlabel="ms per step", ylabel=f"{words}, {unit}")
        caption = "Score and time of the candidates, on training segments."
        axes.legend(frameon=False)
        return Chart("trade-off", caption, caption, axes.figure).drawn("png", dpi=200)
