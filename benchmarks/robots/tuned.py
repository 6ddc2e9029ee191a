"""What ``deqmcl tune`` writes: the best parameters, the held-out gain, a picture."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from benchmarks.report.page import no_report
from benchmarks.report.tables import Table
from benchmarks.robots.nav2 import nav2_document
from benchmarks.robots.replaying import sweep_file
from benchmarks.robots.search import BELIEVED, RUNS, Search
from benchmarks.setup.overrides import NOTHING, Overrides, file_names
from benchmarks.sweeps import Sweep
from benchmarks.sweeps.store import write_files
from benchmarks.tables import estimated, fixed, percent, rounded
from benchmarks.tables.frames import by_world, csv_of
from benchmarks.tables.stats import Interval, estimate
from benchmarks.trials import Method
from deqmcl_gym.files import command_line, utf8
from deqmcl_gym.validation import InputError

NAV2 = "nav2.yaml"
_LEAST = 6  # segments: of fewer, a sign test could not tell any difference from chance (p < 0.05)
_KINDS = ("dropped on fewer segments", "on all training segments", "default", "winner")
_SURE, _FALLEN = 0.9, 0.05  # warn of a share in the 95 % region below this that fell by that
_UNITS = {"share": (100, ".1f", " %"), "nats": (1, ",.2f", " nats"), "m": (1, ".3f", " m")}


def write_tuned(
    tuning: Search, out: Path, words: Sequence[str], nav2: Path | None, node: str | None
) -> str:
    """Write the folder of a search by a command of these words; return what to print."""
    table = segments_table(tuning)
    best, why_not = _nav2(tuning, nav2, node)
    parts = {
        f"# {tuning.task.localizer}, tuned": f"{gain(tuning, table)}{_too_sure(tuning)}\n\n"
        f"{_scores(tuning)}\n\nPublish its covariance by localizers.{tuning.calibrations['tuned']} "
        f"(the default's by {tuning.calibrations['default']}), fitted to the training segments.",
        "## Best parameters": _changed(tuning),
    }
    page = {**parts, "## How this was made": _made(tuning, words)}
    rows = pd.DataFrame(map(vars, tuning.tried)).astype({"whole_space": int}).drop(columns="values")
    values = [dict(candidate.values) for candidate in tuning.tried]
    parameters = pd.DataFrame(values, columns=[*tuning.task.space], dtype=object)
    candidates = pd.concat([rows, parameters], axis=1)  # no values of the default
    contents = {
        "best.toml": utf8(_sweep_file(tuning, words)),
        "tuned.md": utf8("\n\n".join(f"{name}\n\n{text}" for name, text in page.items()) + "\n"),
        "tuned.csv": utf8(csv_of(table)),
        "candidates.csv": utf8(candidates.to_csv(index_label="candidate", lineterminator="\n")),
    }
    if best is not None:
        contents[NAV2] = utf8(best)
    if (why := no_report()) is None:
        contents["trade-off.png"] = _trade_off(tuning)
    names = ", ".join(path.name for path in write_files(out, contents))
    texts = [*parts.values(), why_not, f"Written to {out}: {names}.", why and f"No picture: {why}"]
    return "\n\n".join(filter(None, texts))


def segments_table(tuning: Search) -> pd.DataFrame:
    """Return a row per held-out segment; those where a run failed have no numbers."""
    runs = tuning.held_out[tuning.task.goal.name]
    segments = [
        (file_names(part.world["log"]), round(part.begins, 2), round(part.metres, 2), RUNS)
        for part in tuning.task.held_out
    ]
    table = pd.DataFrame(segments, columns=["log", "begins_s", "metres", "runs"])
    means = {which: by_world(runs[which]) for which in ("default", "tuned")}
    return table.assign(**means, difference=means["tuned"] - means["default"])


def _failed(tuning: Search) -> pd.DataFrame:
    """Return whether a run failed, a row per held-out segment."""
    failed = tuning.held_out.isna().all(axis=1)
    return failed.groupby(["which", "trial"]).any().unstack("which")


def gain(tuning: Search, table: pd.DataFrame) -> str:
    """Say the held-out result of default and winner, paired, and what it shows."""
    goal, limit = tuning.task.goal, tuning.task.max_ms
    pairs = table[["default", "tuned", "difference"]].dropna()
    before, after, off = pairs.to_numpy(float).T
    on = f"on {len(pairs)} of {len(table)} held-out segments, {RUNS} runs each"
    slow = ""
    if limit is not None and not tuning.best.ms_per_step <= limit:
        slow = f"Nothing that was tried keeps to {limit:g} ms per step; this is the best of all. "
    if pairs.empty:
        return f"{slow}No held-out segment could be compared, as runs failed there."
    factor, form, unit = _UNITS[goal.unit]
    if tuning.best.values == NOTHING:
        which = "candidate" if limit is None or slow else f"candidate of at most {limit:g} ms"
        return (
            f"{slow}No gain: no {which} was better than the default on the training segments. The "
            f"default's {goal.words} {on}: {factor * before.mean():{form}}{unit}."
        )
    change = estimate(off) if len(off) >= _LEAST else Interval(float(off.mean()))
    scaled = Interval(*(factor * end for end in change))
    points = " points" if goal.unit == "share" else unit
    return (
        f"{slow}{goal.words[:1].upper()}{goal.words[1:]} {on}: {factor * before.mean():{form}} → "
        f"{factor * after.mean():{form}}{unit}, {(goal.sign * off < 0).sum()} of {len(off)} "
        f"segments better; difference {estimated(scaled, f'+{form}', points)}. "
        f"{_conclusion(tuning, change)}"
    )


def _conclusion(tuning: Search, change: Interval) -> str:
    limit, failed, hidden = tuning.task.max_ms, _failed(tuning), "a gain is not shown."
    if math.isnan(change.low):
        return f"Fewer than {_LEAST} segments are too few for an interval: {hidden}"
    if (failed["tuned"] & ~failed["default"]).any():
        return f"The tuned parameters fail where the default does not: {hidden}"
    if change.low <= 0 <= change.high:
        return f"The 95 % interval includes 0: {hidden}"
    if tuning.task.goal.sign * change.mean < 0:
        return "The 95 % interval excludes 0."
    slow = limit is not None and not tuning.tried[0].ms_per_step <= limit
    keep = f"but the default takes more than {limit:g} ms per step" if slow else "keep the default"
    return f"The tuned parameters are worse on held-out segments: {keep}."


def _too_sure(tuning: Search) -> str:
    """Warn that the winner's region holds less of the reference than the default's."""
    before, after = tuning.held_out.groupby("which")[BELIEVED].mean()
    if not (after < _SURE and after < before - _FALLEN):
        return ""
    return (
        f" Warning: the 95 % region that the tuned filter believes holds {percent(after, 1)} of "
        f"the reference, that of the default {percent(before, 1)}: do not trust its covariance as "
        "it is, publish it by the calibration."
    )


def _scores(tuning: Search) -> str:
    """Return what default and winner have on the held-out segments."""
    runs = tuning.held_out.groupby("which")
    mean, failed = runs.mean(), _failed(tuning).sum()
    columns = {
        "held-out": mean.index.to_series(),
        "median error, m": mean["position_median"].map("{:.3f}".format),
        "95 %, m": mean["position_p95"].map("{:.3f}".format),
        "within 1 m, 30°": [percent(share, 1) for share in mean["within_1m"]],
        "inside 95 % region": [percent(share, 1) for share in mean["coverage_95"]],
        "as believed": [percent(share, 1) for share in mean[BELIEVED]],
        "ms per step": runs["ms_per_step"].median().map(fixed),
        "segments with a failed run": failed,
    }
    return Table("", pd.DataFrame(columns)).text("pipe")


def _changed(tuning: Search) -> str:
    """Return the values of the winner beside those of the default."""
    best, usual = tuning.best.values, tuning.task.usual
    if best == NOTHING:
        return "The default; no value is changed."
    names = [name for name in tuning.task.space if name in best]
    columns = {"parameter": [f"`{name}`" for name in names]}
    for title, values in {"default": usual, "tuned": best}.items():
        each = [values.get(name, "its own") for name in names]
        columns[title] = [rounded(v) if isinstance(v, float) else str(v) for v in each]
    return Table("", pd.DataFrame(columns)).text("pipe")


def _made(tuning: Search, words: Sequence[str]) -> str:
    task, count = tuning.task, len(tuning.tried)
    metres = float(np.mean([segment.metres for segment in (*task.training, *task.held_out)]))
    limit = "" if task.max_ms is None else f" At most {task.max_ms:g} ms per step were allowed."
    return (
        f"    {command_line(words)}\n\n"
        f"{count} candidates. Segments of {metres:.0f} m: {len(task.training)} trained on, "
        f"{len(task.held_out)} held out, in turn; the search does not see the latter.{limit} "
        f"Winner on the training segments: {tuning.best.value:.4g}, default "
        f"{tuning.tried[0].value:.4g}; these two are what was searched for, so their difference is "
        "too good. Intervals: bootstrap over segments, which are of the same building; they do not "
        "tell of another one."
    )


def _sweep_file(tuning: Search, words: Sequence[str]) -> str:
    """Return the winner as a sweep file over the first log."""
    task, segment = tuning.task, tuning.task.training[0]
    trial = task.trial(tuning.best.values, segment)
    sweep = Sweep(
        title=f"{task.localizer}, tuned",
        scenario=trial.scenario,
        lag=0,
        localizers=(Method(task.localizer, trial.params),),
        world=segment.whole,
        assumed=Overrides({n: v for n, v in trial.assumed.items() if not n.startswith("prior.")}),
        baseline=task.localizer,
        takes=lambda _: (),
    )
    published = f"publish its covariance by localizers.{tuning.calibrations['tuned']}"
    return sweep_file(sweep, [" ".join(command_line(words).split()), published])


def _nav2(tuning: Search, path: Path | None, node: str | None) -> tuple[str | None, str]:
    """Return nav2.yaml, or None and why there is none."""
    task = tuning.task
    if task.localizer != "amcl":
        return None, f"No {NAV2}: {task.localizer} is not a filter of Nav2."
    try:
        params = task.trial(tuning.best.values, task.training[0]).params
        document = nav2_document(params, path, node)
    except InputError as error:
        return None, f"No {NAV2}: {error}"
    return yaml.safe_dump(document, sort_keys=False), ""


def _trade_off(tuning: Search) -> bytes:
    """Return the picture of score and time of all candidates on all training segments."""
    from matplotlib.ticker import LogLocator, NullLocator

    from benchmarks.report.charts import Chart, canvas, line, styled

    goal, frame = tuning.task.goal, pd.DataFrame(map(vars, tuning.tried))
    factor, _, unit = _UNITS[goal.unit]
    kinds = [_KINDS[segments == len(tuning.task.training)] for segments in frame["segments"]]
    kinds[tuning.tried.index(tuning.best)] = _KINDS[3]
    kinds[0] = _KINDS[2]
    frame = frame.assign(value=factor * frame["value"], label=pd.Categorical(kinds, _KINDS))
    frame = frame[np.isfinite(frame["value"]) & (frame["ms_per_step"] > 0)]
    with styled():
        axes = line(frame, "ms_per_step", "value", axes=canvas(6.4, 3.8), ls="")
        label = goal.words.replace("share of records ", "")
        axes.set(xlabel="ms per step", ylabel=f"{label},{unit}", xscale="log")
        if goal.unit == "nats":  # those of a filter that is lost and sure are huge
            axes.set_yscale("symlog", linthresh=10)
        elif goal.unit == "m" and (frame["value"] > 0).all():
            axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis)[: 1 + (axes.get_yscale() == "log")]:
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_minor_locator(NullLocator())
            axis.set_major_formatter("{x:g}")
        caption = "Score and time of the candidates, on training segments."
        return Chart("trade-off", caption, caption, axes.figure).drawn("png", dpi=200)
