"""The tables of docs/wrong-map.md."""

from collections.abc import Mapping, Sequence
from functools import partial

from docs.numbers.reading import AMCL, DRAWS, OWN, ROBOT, SUCCESS, Cells, filled, row, table

Row = Mapping[str, str]
Given = Mapping[str, object]
Level = tuple[int, float, int]  # things, share of the inner walls, people

LEVELS: Sequence[Level] = ((0, 0.0, 0), (20, 0.15, 10), (40, 0.3, 20), (80, 0.5, 40))
MIDDLE = LEVELS[2]
ALONE: Sequence[Level] = ((80, 0.0, 0), (0, 0.5, 0), (0, 0.0, 40))
LATENT = "latent-share"
UNIFORM = "censored-gaussian-uniform"
SKIPPING = {"laser_model_type": "likelihood_field_prob"}
DISTANCE, ENTROPY = {"beam_filter": "distance"}, {"beam_filter": "entropy"}
FILTERS: Mapping[str, tuple[str, Given]] = {
    "`mcl-map`": ("mcl-map", {}),
    "… `beam_filter=distance`": ("mcl-map", DISTANCE),
    "… `beam_filter=entropy`": ("mcl-map", ENTROPY),
    "`mcl-plan`": ("mcl-plan", {}),
    "`mcl-plan-hedged`": ("mcl-plan-hedged", {}),
    OWN: ("amcl", ROBOT),
    AMCL: ("amcl", {}),
    "… with `do_beamskip`": ("amcl", SKIPPING),
}
FEW = {"particles": 5_000}
LOST: Mapping[str, tuple[str, Given]] = {
    "`mcl`, N = 5,000": ("mcl", FEW),
    "`mcl`, N = 12,500": ("mcl", {"particles": 12_500}),
    "`mcl-map`, N = 5,000": ("mcl-map", {}),
    "… the route used at the start": ("mcl-map", DRAWS),
    f"{OWN}, at most 10,000": ("amcl", ROBOT),
}
SIGNALS = ("quality", "explained", "beyond_random", "short", "long", "repeated", "elsewhere")
_TELLING = dict.fromkeys((*ROBOT, *DISTANCE, *DRAWS))  # None: parameters that a row may not have
AUROC = "{auroc:.2f} ({auroc_low:.2f} to {auroc_high:.2f})"
ERROR, RELATIVE = "{error:.3f}", "{relative:+.1p} % ({relative_low:+.1p} to {relative_high:+.1p})"


def _at(level: Level, **more: str) -> dict[str, object]:
    """A level as rows of a report have it."""
    things, share, people = level
    return {
        "clutter.number": things, "changed_walls.share": share, "people.number": people, **more
    }  # fmt: skip


def _found(report: str, scenario: str, where: Given, method: str, given: Given) -> Row:
    """The row of a filter with these parameters, and with no others of ``_TELLING``."""
    return row(f"wrong-map/{report}", scenario, method, where=where, **{**_TELLING, **given})


def _known(level: Level, method: str, given: Given, kind: str = "") -> Row:
    """The row of a filter that knows its start, for a level and a model of scans."""
    where = _at(level) | {"scan.kind": kind or UNIFORM}
    return _found("known", "wrong-map", where, method, given)


def _tracked() -> str:
    rows = []
    for kind in ("", LATENT):
        for label, (method, params) in FILTERS.items():
            if kind and method == "amcl" and params != ROBOT:
                continue  # it has a model of scans of its own
            found = (_known(level, method, params, kind) for level in LEVELS)
            shares = [filled(SUCCESS, one) for one in found]
            rows.append([f"{label}, `{kind}`" if kind else label, *shares])
    return table("filter | right map: | low: | middle: | high:", rows)


def _costs() -> str:
    rows = []
    for kind in ("", LATENT):
        for label, (method, params) in FILTERS.items():
            if (kind and (method != "mcl-map" or params)) or (method == "amcl" and params != ROBOT):
                continue
            cells = [f"{label}, `{kind}`" if kind else label]
            for level in (LEVELS[0], MIDDLE):
                found = _known(level, method, params, kind)
                cells += [filled(ERROR, found), "" if kind else filled(RELATIVE, found)]
            rows.append([*cells, filled("{ms_per_step:.1f}", found)])
    head = "filter | error with a right map, m: | − that of `mcl-map`, of it:"
    return table(
        f"{head} | error at the middle level, m: | − that of `mcl-map`, of it: | ms per step:", rows
    )


def _alone() -> str:
    def cells(label: str, method: str, params: Given) -> Cells:
        found = (_known(level, method, params) for level in ALONE)
        return [label, *(filled(SUCCESS, one) for one in found)]

    rows = [cells(label, *of) for label, of in FILTERS.items()]
    return table("filter | 80 things: | half of the inner walls: | 40 people:", rows)


def _lost() -> str:
    rows = []
    for label, (method, params) in LOST.items():
        found = [
            _found("lost", "wrong-map-lost", _at(level), method, params) for level in LEVELS[:3]
        ]
        rows.append([label, *(filled(SUCCESS, one) for one in found)])
        rows[-1].append(filled("{ms_per_step:.1f}", found[-1]))
    return table("filter | right map: | low: | middle: | ms per step:", rows)


def _equal_time() -> str:
    rows = []
    for label, many, given in (
        ("`mcl-map`", 4_000, {}),
        ("… `beam_filter=distance`", 2_600, DISTANCE),
        ("… `beam_filter=entropy`", 3_000, ENTROPY),
        ("`mcl-plan`", 2_000, {}),
        ("`mcl-plan-hedged`", 2_000, {}),
    ):
        method = label.strip("`") if not given else "mcl-map"
        own = row("wrong-map/equal-time", "wrong-map", method, many, **given)
        interval = f"{ERROR} ({{error_low:.3f}} to {{error_high:.3f}})"
        values = (filled(form, own) for form in (SUCCESS, interval, "{ms_per_step:.1f}"))
        rows.append([label, f"{many:,}", *values])
    return table("filter | N: | localized: | error, m: | ms per step:", rows)


ON_LOGS: Mapping[str, Mapping[str, tuple[str, Given]]] = {
    "known": FILTERS,
    "anywhere": {
        "`mcl`": ("mcl", {}),
        "… `beam_filter=distance`": ("mcl", DISTANCE),
        "`mcl-map`, the route used at the start": ("mcl-map", DRAWS),
        OWN: ("amcl", ROBOT),
        f"{AMCL}, with `do_beamskip`": ("amcl", SKIPPING),
    },
}
BUILDINGS, CHANGED = ("freiburg-079", "intel"), (0.0, 0.1, 0.3)


def _on_logs(start: str) -> str:
    places = [(one, share) for one in BUILDINGS for share in CHANGED]
    worlds = [{"map": f"{one}.yaml", "changed_walls.share": share} for one, share in places]
    form = ("{success_1m" if start == "anywhere" else "{lost_rate") + ":.0p} %, {error:.3f} m"
    rows = []
    for label, (method, params) in ON_LOGS[start].items():
        own = (_found(f"log-{start}", "log", world, method, params) for world in worlds)
        rows.append([label, *(filled(form, one) for one in own)])
    heads = (f"{one}, {share:.0%}".replace("%", " %:") for one, share in places)
    return table(" | ".join(["filter", *heads]), rows)


def _told_apart() -> str:
    rows = []
    for signal in SIGNALS:
        cells = [f"`{signal}`"]
        for question in ("lost", "wrong", "wrong_localized", "which"):
            where = _at(MIDDLE, question=question, signal=signal)
            found = _found("lost-maps", "wrong-map-lost", where, "mcl", FEW)
            cells.append(filled(AUROC, found))
        rows.append(cells)
    head = "signal | lost, against the rest: | the map is wrong here, against the rest:"
    return table(
        f"{head} | the same, among steps that are not lost: | lost, against the map is wrong:", rows
    )


TABLES = {
    "wrong-map, tracked": _tracked,
    "wrong-map, costs": _costs,
    "wrong-map, alone": _alone,
    "wrong-map, lost": _lost,
    "wrong-map, equal time": _equal_time,
    "wrong-map, logs, known": partial(_on_logs, "known"),
    "wrong-map, logs, anywhere": partial(_on_logs, "anywhere"),
    "wrong-map, told apart": _told_apart,
}
