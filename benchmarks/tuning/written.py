"""What ``deqmcl tune`` writes: the best parameters, the held-out gain, what mattered, a picture."""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from tabulate import tabulate

from benchmarks.files import write_files
from benchmarks.replay.nav2 import nav2_document
from benchmarks.report.writing import load, no_report
from benchmarks.setup.overrides import NOTHING, Overrides, file_names
from benchmarks.sweeps.settings import sweep_text
from benchmarks.tables.frames import milliseconds_per_step
from benchmarks.tables.stats import Interval, estimate
from benchmarks.tables.text import csv_text, estimated, fixed, percent, significant
from benchmarks.trials.scores import TRACK_SCORES, Score
from benchmarks.trials.scoring import Finished
from benchmarks.tuning.search import RUNS, Found, Tried
from benchmarks.tuning.space import Space
from benchmarks.tuning.task import GOALS, Task, value_of
from deqmcl_gym.files import command_line, utf8
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError

NAV2 = "nav2.yaml"
_SHUFFLES = 1000  # of the ranks, for what chance would give
_BINS = 4  # of a range
_FEW = 20  # candidates below which importance says nothing
_LEAST = 6  # segments: of fewer, a sign test could not tell any difference from chance (p < 0.05)
_COLUMNS = ("log", "begins_s", "metres", "runs", "default", "tuned", "difference")
_COVERAGE = TRACK_SCORES["coverage_95"]
_KINDS = ("dropped on fewer segments", "on all training segments", "default", "winner")
_SURE, _FALLEN = 0.9, 0.05  # share inside the 95 % region below which, and fall that, is told
_UNITS = {"share": (100, ".1f", " %"), "nats": (1, ",.2f", " nats"), "m": (1, ".3f", " m")}


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
    rows = segment_rows(found)
    best, why_not = _nav2(found.task, found.best, nav2, node)
    said = f"{verdict(found, rows)}{_too_sure(found)}"
    parts = {
        f"# {found.task.localizer}, tuned": f"{said}\n\n{_table(found)}",
        "## Best parameters": _changed(found),
        "## Which parameters mattered": _importance(found),
    }
    page = {**parts, "## How this was made": _made(found, words)}
    contents = {
        "best.toml": utf8(_sweep_file(found, words)),
        "tuned.md": utf8("\n\n".join(f"{name}\n\n{text}" for name, text in page.items()) + "\n"),
        "tuned.csv": utf8(csv_text(_COLUMNS, rows)),
        "candidates.csv": utf8(_candidates(found)),
    }
    if best is not None:
        contents[NAV2] = utf8(best)
    if (why := no_report()) is None:
        load()
        contents["trade-off.png"] = _trade_off(found)
    files = write_files(out, contents)
    texts = [*parts.values(), why_not]
    texts.append(f"Written to {out}: {', '.join(path.name for path in files)}.")
    texts.append("" if why is None else f"No picture: {why}")
    return "\n\n".join(filter(None, texts))


def segment_rows(found: Found) -> list[list[Any]]:
    """Return a line per held-out segment; those where a run failed have no numbers."""
    goal, lines = found.task.goal, []
    each = zip(found.task.held_out, found.default_runs, found.best_runs, strict=True)
    for segment, *runs in each:
        before, after = (_mean(goal, own) if len(own) == RUNS else math.nan for own in runs)
        log = file_names(segment.world["log"])
        begins, metres = round(segment.begins, 2), round(segment.metres, 2)
        lines.append([log, begins, metres, RUNS, before, after, after - before])
    return lines


def _mean(goal: Score, records: Sequence[Finished]) -> float:
    return float(np.mean([value_of(goal, one) for one in records])) if records else math.nan


def verdict(found: Found, rows: Sequence[Sequence[Any]]) -> str:
    """Say the held-out result of default and winner, paired, and what it shows."""
    goal, limit = found.task.goal, found.task.max_ms
    before, after = np.array([row[4:6] for row in rows], np.float64).T
    known = ~np.isnan(before + after)
    off = (after - before)[known]
    on = f"on {known.sum()} of {known.size} held-out segments, {RUNS} runs each"
    slow = ""
    if limit is not None and not found.best.ms <= limit:
        slow = f"Nothing that was tried keeps to {limit:g} ms per step; this is the best of all. "
    if not off.size:
        return f"{slow}No held-out segment could be compared, as runs failed there."
    if found.best.values == NOTHING:
        which = "candidate" if limit is None or slow else f"candidate of at most {limit:g} ms"
        value = _number(goal, before[known].mean())
        return (
            f"{slow}No gain: no {which} was better than the default on the training segments. The "
            f"default's {goal.words} {on}: {value}."
        )
    gain = estimate(off) if len(off) >= _LEAST else Interval(float(off.mean()))
    factor, form, unit = _UNITS[goal.unit]
    scaled = Interval(*(factor * one for one in gain))
    points = " points" if goal.unit == "share" else unit
    return (
        f"{slow}{goal.words[:1].upper()}{goal.words[1:]} {on}: "
        f"{_number(goal, before[known].mean(), bare=True)} → "
        f"{_number(goal, after[known].mean())}, {(goal.sign * off < 0).sum()} of {len(off)} "
        f"segments better; difference {estimated(scaled, f'+{form}', points)}. "
        f"{_conclusion(found, gain)}"
    )


def _conclusion(found: Found, gain: Interval) -> str:
    limit = found.task.max_ms
    if math.isnan(gain.low):
        return f"Fewer than {_LEAST} segments are too few for an interval: a gain is not shown."
    each = zip(found.default_runs, found.best_runs, strict=True)
    if any(len(tuned) < RUNS <= len(default) for default, tuned in each):
        return "The tuned parameters fail where the default does not: a gain is not shown."
    if not (gain.low > 0 or gain.high < 0):
        return "The 95 % interval includes 0: a gain is not shown."
    if found.task.goal.sign * gain.mean < 0:
        return "The 95 % interval excludes 0."
    slow = limit is not None and not found.tried[0].ms <= limit
    keep = f"but the default takes more than {limit:g} ms per step" if slow else "keep the default"
    return f"The tuned parameters are worse on held-out segments: {keep}."


def _number(goal: Score, value: float, *, bare: bool = False) -> str:
    factor, form, unit = _UNITS[goal.unit]
    return f"{factor * value:{form}}{'' if bare else unit}"


def _too_sure(found: Found) -> str:
    """Warn that the winner's region holds less of the reference than the default's."""
    before, after = (
        _mean(_COVERAGE, [record for own in runs for record in own])
        for runs in (found.default_runs, found.best_runs)
    )
    if not (after < _SURE and after < before - _FALLEN):
        return ""
    return (
        f" Warning: the 95 % region of the tuned parameters holds {percent(after, 1)} of the "
        f"reference, that of the default {percent(before, 1)}: do not trust their covariance, or "
        "tune by --score log-score, which looks at it, too."
    )


def _table(found: Found) -> str:
    """Return what default and winner have on the held-out segments."""
    scores = {"median error, m": GOALS["median"], "95 %, m": GOALS["p95"]}
    shares = {"within 1 m, 30°": GOALS["localized"]}
    shares["inside 95 % region"] = _COVERAGE
    lines = []
    for name, runs in {"default": found.default_runs, "tuned": found.best_runs}.items():
        records = [record for own in runs for record in own]
        cells = [f"{_mean(score, records):.3f}" for score in scores.values()]
        cells += [percent(_mean(score, records), 1) for score in shares.values()]
        ms = fixed(milliseconds_per_step(records)) if records else "–"
        failed = sum(len(own) < RUNS for own in runs)
        lines.append([name, *cells, ms, str(failed)])
    header = ["held-out", *scores, *shares, "ms per step", "segments with a failed run"]
    return _markdown(lines, header)


def _markdown(lines: Sequence[Sequence[str]], header: Sequence[str]) -> str:
    right = ["left", *["right"] * (len(header) - 1)]
    return tabulate(lines, header, tablefmt="pipe", disable_numparse=True, colalign=right)


def _changed(found: Found) -> str:
    """Return the values of the winner beside those of the default."""
    task, best = found.task, found.best.values
    if best == NOTHING:
        return "The default; no value is changed."
    names = [name for name in task.space if name in best]
    lines = [[f"`{n}`", _word(task.usual.get(n, "its own")), _word(best[n])] for n in names]
    return _markdown(lines, ["parameter", "default", "tuned"])


def _word(value: Any) -> str:
    return significant(value) if isinstance(value, float) else str(value)


def importance(space: Space, tried: Sequence[Tried]) -> list[tuple[str, float, float, str]]:
    """Return which parameters explain ranks of candidates alone, the most important first.

    The ranks are those of the candidates drawn from the whole space, in the first rung of their
    round. A range is cut into four at the quartiles of what was drawn, one with four values or
    fewer into these. The share is ε², the correlation ratio η² less what as many groups would
    explain by chance (Kelley 1935): the main effects of a functional ANOVA.

    Returns:
        (name, ε², its 95 % quantile over shuffled ranks, the best group in words).
    """
    free = [one for one in tried if one.free]
    ranks = np.array([one.rank for one in free])
    shuffled = np.random.default_rng(0).permuted(np.tile(ranks, (_SHUFFLES, 1)), axis=1)
    found = []
    for name in space:
        groups: Any = pd.Series([one.values[name] for one in free])
        if pd.api.types.is_numeric_dtype(groups) and groups.nunique() > _BINS:
            groups, ends = pd.qcut(groups, _BINS, labels=False, retbins=True, duplicates="drop")
            words = [f"{significant(a)} to {significant(b)}" for a, b in pairwise(ends)]
            groups = groups.map(dict(enumerate(words)))
        best = str(pd.Series(ranks).groupby(groups, sort=False).mean().idxmin())
        codes = pd.factorize(groups)[0]
        chance = float(np.quantile(_explained(shuffled, codes), 0.95))
        found.append((name, float(_explained(ranks[None], codes)[0]), chance, best))
    return sorted(found, key=lambda row: -row[1])


def _explained(ranks: Floats, codes: Any) -> Floats:
    """Return ε² of rows of ranks, (m, n), in groups of these numbers, (n,)."""
    n, k = len(codes), int(codes.max()) + 1
    if n <= k:
        return np.zeros(len(ranks))
    inside = np.eye(k)[codes]
    off = ranks - ranks.mean(axis=1, keepdims=True)
    whole = (off**2).sum(axis=1)
    between = ((off @ inside) ** 2 / inside.sum(axis=0)).sum(axis=1)
    return np.asarray(1 - ((whole - between) / (n - k)) / (whole / (n - 1)))


def _importance(found: Found) -> str:
    free = sum(one.free for one in found.tried)
    if free < _FEW:
        return f"{free} candidates from the whole space are too few to say; it takes {_FEW}."
    rows = importance(found.task.space, found.tried)
    lines = [[f"`{n}`", percent(share), best] for n, share, chance, best in rows if share > chance]
    rest = [f"`{name}`" for name, share, chance, _ in rows if share <= chance]
    texts = [
        f"Share of the variance of ranks among {free} candidates drawn from the whole space that "
        "a parameter explains alone (ε² over four parts of its range, or over its values if it has "
        "four or fewer)."
    ]
    texts += [_markdown(lines, ["parameter", "explains", "best"])] if lines else []
    texts += [f"Not more than chance: {', '.join(rest)}."] if rest else []
    return "\n\n".join(texts)


def _made(found: Found, words: Sequence[str]) -> str:
    task, count = found.task, len(found.tried)
    metres = float(np.mean([one.metres for one in task.segments]))
    limit = "" if task.max_ms is None else f" At most {task.max_ms:g} ms per step were allowed."
    return (
        f"    {command_line(words)}\n\n"
        f"{count} candidates. Segments of {metres:.0f} m: {len(task.training)} trained on, "
        f"{len(task.held_out)} held out, in turn; the search does not see the latter.{limit} "
        f"Winner on the training segments: {found.best.value:.4g}, default "
        f"{found.tried[0].value:.4g}; these two are what was searched for, so their difference is "
        "too good. Intervals: bootstrap over segments, which are of the same building; they do not "
        "tell of another one."
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
        params = Overrides({"lag": lag}) | params
    own = {n: v for n, v in segment.assumed.items() if not n.startswith("prior.")}
    localizer = {"name": task.localizer, **{f"params.{n}": v for n, v in params.items()}}
    return sweep_text(
        [" ".join(command_line(words).split())],
        {"scenario": "replay", "lag": 0},
        {"world": segment.whole, "assumed": {**own, **assumed}, "[localizers]": localizer},
    )


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
    from benchmarks.report.charts import STYLE, Chart, canvas, line

    goal, last = found.task.goal, len(found.task.training)
    factor, _, unit = _UNITS[goal.unit]

    def kind(one: Tried) -> str:
        if one.values == NOTHING or one is found.best:
            return _KINDS[2 if one.values == NOTHING else 3]
        return _KINDS[one.segments == last]

    x, y = "ms per step", goal.words.replace("share of records ", "") + f",{unit}"
    known = [one for one in found.tried if math.isfinite(one.value) and one.ms > 0]
    frame = pd.DataFrame([(one.ms, factor * one.value, kind(one)) for one in known])
    frame.columns = pd.Index([x, y, "label"])
    frame["label"] = pd.Categorical(frame["label"], _KINDS)
    with styled(STYLE):
        axes = line(frame, x, y, axes=canvas(6.4, 3.8), ls="")
        axes.set(xlabel=x, ylabel=y, xscale="log")
        if goal.unit == "nats":  # those of a filter that is lost and sure are huge
            axes.set_yscale("symlog", linthresh=10)
        elif goal.unit == "m" and (frame[y] > 0).all():
            axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis)[: 1 + (axes.get_yscale() == "log")]:
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_minor_locator(NullLocator())
            axis.set_major_formatter("{x:g}")
        caption = "Score and time of the candidates, on training segments."
        return Chart("trade-off", caption, caption, axes.figure).drawn("png", dpi=200)
