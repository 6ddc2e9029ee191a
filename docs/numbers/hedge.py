"""The tables of the hedge, and what the page of the plan as a sensor says of it."""

import json
import math
from collections.abc import Iterable, Mapping

from docs.numbers.reading import (
    ARRIVED,
    DIFF_METRES,
    DRAWS,
    METRES,
    RECOVERED,
    SUCCESS,
    Number,
    filled,
    read,
    row,
    rows_where,
    table,
)

SENSORS = ((1, 100.0, "weak"), (9, 50.0, "middle"), (9, 5.0, "sharp"))
NOISES = ((0.02, "small"), (0.2, "large"))
AUTHORS = {
    "guided": "from the true pose, at every step (`guided`)",
    "guided-before": "before the start (`guided-before`)",
    "guided-estimate": "from the localizer's estimate (`guided-estimate`)",
    "guided-stale": "for another start (`guided-stale`)",
}


ENDS: Mapping[str, tuple[str, dict[str, object]]] = {
    "`mcl-plan-hedged`": ("mcl-plan-hedged", {}),
    "`mcl-plan`": ("mcl-plan", {}),
    "`mcl-plan`, `keep` = 0": ("mcl-plan", {"keep": 0.0}),
    "`deq-mcl`": ("deq-mcl", {}),
    "`deq-mcl-rejuvenated`": ("deq-mcl-rejuvenated", {}),
    "`mcl-pilots`": ("mcl-pilots", {}),
}
CORRIDOR = 100.0  # px: how wide those of the room are


def _world(beams: int, sigma: float, noise: float) -> dict[str, object]:
    """A sensor and a noise of the motion, as rows of a report have them."""
    return {"lidar.beams": beams, "lidar.sigma": sigma, "noise.drive": noise}


def _shown(found: Mapping[str, str]) -> str:
    """A difference with enough digits; bold if its interval and Holm's p exclude 0."""
    digits = 1 if abs(float(found["diff"])) >= 5 else 2
    spec = f"{{diff:+.{digits}f}} ({{diff_low:.{digits}f}} to {{diff_high:.{digits}f}})"
    low, high = float(found["diff_low"]), float(found["diff_high"])
    sure = (low > 0 or high < 0) and float(found["p_holm"]) < 0.05
    return f"**{filled(spec, found)}**" if sure else filled(spec, found)


def _authors() -> str:
    rows = []
    for scenario, words in AUTHORS.items():
        first = words
        for beams, sigma, sensor in SENSORS:
            for noise, size in NOISES:
                world = {"scenario": scenario} | _world(beams, sigma, noise)
                by = {r["method"]: r for r in rows_where("hedge/authors", world)}
                base = filled("{error:.1f}", by["mcl-map"])
                cells = [_shown(by[method]) for method in ("mcl-plan", "mcl-plan-hedged")]
                rows.append([first, f"{sensor}, {size}", base, *cells])
                first = ""
    head = "the plan was made … | sensor, noise | `mcl-map`, px: | `mcl-plan`:"
    return table(f"{head} | `mcl-plan-hedged`:", rows)


def _stale() -> str:
    rows = []
    kinds = (("mcl-map", 300), ("mcl-map", 150), ("mcl-plan-hedged", 300), ("mcl-plan-hedged", 600))
    for beams, sigma, sensor in SENSORS:
        for noise, size in NOISES:
            by = {
                (r["method"], json.loads(r["params"])["particles"]): r
                for r in rows_where("hedge/stale", _world(beams, sigma, noise))
            }
            rows.append([f"{sensor}, {size}", *(filled("{error:.2f}", by[kind]) for kind in kinds)])
    head = "sensor, noise | `mcl-map`, N = 300: | `mcl-map`, N = 150:"
    return table(f"{head} | hedged, N = 150 + 150: | hedged, N = 300 + 300:", rows)


def _equal_time() -> str:
    rows = []
    for label, method, n in (
        ("`mcl-plan`, N = 1,000", "mcl-plan", 1000),
        ("`mcl-plan-hedged`, N = 1,000", "mcl-plan-hedged", 1000),
        ("`mcl-map`, N = 8,000", "mcl-map", 8000),
        ("MCL, N = 8,000", "mcl", 8000),
    ):
        found = row("hedge/equal-time", "guided", method, n)
        spec = "{diff:+.2f} ({diff_low:.2f} to {diff_high:.2f})"
        cost = filled("{cost:.2g}", found)
        rows.append([label, filled("{error:.2f}", found), filled(spec, found), cost])
    return table(" | error: | difference, 95 % interval: | time per step / `mcl-map`'s:", rows)


def _signals() -> str:
    rows = []
    for beams, sigma, sensor in SENSORS:
        for noise, size in NOISES:
            found = {
                (r["method"], r["signal"]): filled(
                    "{auroc:.2f} ({auroc_low:.2f} to {auroc_high:.2f})", r
                )
                for r in rows_where("hedge/authors-plans", _world(beams, sigma, noise))
            }
            plan = ("feasible", "log_evidence", "log_evidence_20", "tempering", "quality")
            cells = [found["mcl-plan", name] for name in plan]
            cells += [found["mcl-plan-hedged", name] for name in ("trusted", "trusted_lap")]
            rows.append([f"{sensor}, {size}", *cells])
    head = " | feasible share: | log-evidence: | its mean over 20 steps: | λ:"
    return table(f"{head} | quality (scans alone): | trust, q: | its least in a lap:", rows)


def _ends() -> str:
    rows = [
        [
            label,
            *(
                _shown(row("hedge/ends", scenario, method, **params))
                for scenario in ("guided", "guided-stale")
            ),
        ]
        for label, (method, params) in ENDS.items()
    ]
    return table("method | the plan is right (`guided`): | for another start:", rows)


def _smooth() -> str:
    methods = ("mcl-plan", "mcl-plan-hedged")
    by: dict[float, dict[str, dict[str, str]]] = {}
    for found in read("hedge/smooth"):
        if found["offset"] == "0":
            shift = json.loads(found["swept"])["agent.shift"]
            by.setdefault(shift, {})[found["method"]] = found
    rows = [
        [
            f"{shift / CORRIDOR:g}",
            f"{math.degrees(json.loads(own['mcl-plan']['swept'])['agent.turn']):.0f}°",
            *(_shown(own[method]) for method in methods),
        ]
        for shift, own in by.items()
    ]
    return table("shift, corridor widths: | turn: | `mcl-plan`: | `mcl-plan-hedged`:", rows)


def _own() -> str:
    rows = []
    for beams, sigma, sensor in SENSORS:
        for noise, size in NOISES:
            by = {
                json.loads(r["params"]).get("own_plans", r["method"]): r
                for r in rows_where("hedge/own", _world(beams, sigma, noise))
            }
            cells = [_shown(by[kind]) for kind in ("mcl-plan-hedged", False)]
            rows.append([f"{sensor}, {size}", filled("{error:.1f}", by["mcl-map"]), *cells])
    head = "sensor, noise | `mcl-map`, px: | `mcl-plan-hedged`: | `own_plans` = false:"
    return table(head, rows)


def _variants() -> str:
    scenarios = ("guided", "paper", "guided-stale", "guided-before")
    labels = {"`mcl-plan`, `keep` = 0": ("keep", 0.0)}
    labels |= {f"s = {s:g}": ("switching", s) for s in (0.0001, 0.001, 0.01, 0.05, 0.1)}
    labels["s = 0.001, `mutual`"] = "mutual", True
    found = {
        (r["scenario"], name, value): r
        for r in read("hedge/variants")
        for name, value in json.loads(r["params"]).items()
        if r["offset"] == "0"
    }
    rows = [
        [label, *(_shown(found[s, *kind]) for s in scenarios)] for label, kind in labels.items()
    ]
    return table(" | " + " | ".join(f"`{s}`:" for s in scenarios), rows)


def _hedged_lost() -> str:
    columns = [SUCCESS, METRES, DIFF_METRES, "{false_commitment:.0p} %"]
    first = {"plans": "first"}
    rows = []
    for scenario in ("lost", "lost-wrong-route", "lost-weak", "kidnapped", "kidnapped-stale"):
        name = f"`{scenario}`"
        for label, method, params in (
            ("`mcl-map`", "mcl-map", {}), ("`mcl-plan`", "mcl-plan", {}),
            ("`mcl-plan-hedged`", "mcl-plan-hedged", {}),
            ("`mcl-map`, `start_draws`", "mcl-map", DRAWS),
            ("`mcl-plan-hedged`, the first plan only", "mcl-plan-hedged", first),
        ):  # fmt: skip
            found = row("hedge/lost", scenario, method, 2000, **params)
            late = scenario.startswith("kidnapped")
            cells = [c.replace("localize", "recover") if late else c for c in columns]
            if late:
                cells[0] = RECOVERED
            filled_in = [filled(c, found) for c in cells]
            filled_in[2] = filled_in[2] or "baseline"
            rows.append([name, label, *filled_in])
            name = ""
    head = "scenario | method | localized to the end, or recovered: | metres until then, median:"
    return table(f"{head} | difference in metres: | false commitment:", rows)


def _hedged_driving() -> str:
    rows = []
    for scenario in ("driving", "driving-route"):
        for n in (500, 2000):
            for method in ("mcl-map", "mcl-plan", "mcl-plan-hedged"):
                found = row("hedge/driving", scenario, method, n)
                cells = [filled(c, found) for c in (ARRIVED, "{spl:.2f}", "{contacts:.1f}")]
                first = f"`{scenario}`" if method == "mcl-map" and n == 500 else ""
                rows.append([first, f"{n:,}", f"`{method}`", *cells])
    return table("scenario | N: | method | arrived without contact: | SPL: | contacts:", rows)


def _hedged_starts() -> str:
    rows = []
    for building in ("freiburg-079", "intel"):
        name = building
        for label, method, params in (
            ("`mcl-map`, without the plan", "mcl-map", {}),
            ("`mcl-plan`", "mcl-plan", {}),
            ("`mcl-plan-hedged`", "mcl-plan-hedged", {}),
            ("`mcl-map`, `start_draws`", "mcl-map", DRAWS),
            ("`mcl-plan-hedged`, the first plan only", "mcl-plan-hedged", {"plans": "first"}),
        ):
            found = row(f"hedge/{building}", "log", method, 20_000, **params)
            cells = [filled(c, found) for c in (SUCCESS, METRES, DIFF_METRES)]
            rows.append([name, label, *cells[:2], cells[2] or "baseline"])
            name = ""
    head = "building | localizer | localized to the end (1 m, 30°): | metres to localize, median:"
    return table(f"{head} | difference in metres (restricted mean):", rows)


TABLES = {
    "hedge, authors": _authors,
    "hedge, stale": _stale,
    "hedge, equal time": _equal_time,
    "hedge, signals": _signals,
    "hedge, ends": _ends,
    "hedge, smooth": _smooth,
    "hedge, own": _own,
    "hedge, variants": _variants,
    "hedge, lost": _hedged_lost,
    "hedge, driving": _hedged_driving,
    "hedge, starts": _hedged_starts,
}


def sentences() -> Iterable[tuple[str, str]]:
    """Yield what the page of the plan as a sensor must say, word for word."""
    for says in (*_of_rooms(), *_of_journeys()):
        yield "docs/plan-sensor.md", says


def _of_rooms() -> Iterable[str]:
    """Yield what it says at its head."""
    of = row("plan-sensor/results", "guided", "mcl-map", 300)
    error = filled("{error:.1f}", of)
    interval = "95 % interval {diff_low:.1f} to {diff_high:.1f}"
    plan = row("plan-sensor/results", "guided", "mcl-plan", 300)
    yield filled(f"({{diff:.1f}} px of {error}; {interval})", plan)
    hedged = row("hedge/rooms", "guided", "mcl-plan-hedged", 300)
    yield filled(f"{{diff:.1f}} px of the {error} px of `mcl-map` ({interval})", hedged)
    kept = [
        float(row("hedge/rooms", scenario, "mcl-plan-hedged", many)["diff"])
        / float(row("hedge/rooms", scenario, "mcl-plan", many)["diff"])
        for scenario in ("guided", "paper")
        for many in (300, 1000)
    ]
    yield f"keeps {100 * min(kept):.0f} to {100 * max(kept):.0f} % of what"
    authors = {
        (r["scenario"], r["world"], r["method"]): r
        for r in read("hedge/authors")
        if r["offset"] == "0" and r["diff"]
    }
    stale = [
        float(r["diff"])
        for (scenario, _, method), r in authors.items()
        if (scenario, method) == ("guided-stale", "mcl-plan")
    ]
    yield f"adds {min(stale):.1f} to {max(stale):.0f} px with every sensor"
    wrong = [
        (key, r) for key, r in authors.items() if key[0] != "guided" and key[2] == "mcl-plan-hedged"
    ]
    harmed = [key for key, r in wrong if _shown(r).startswith("**+")]
    yield f"no harm was found in {len(wrong) - len(harmed)} of {len(wrong)} settings"
    ends = [
        [float(authors[key[0], key[1], method]["diff"]) for key in harmed]
        for method in ("mcl-plan-hedged", "mcl-plan")
    ]
    yield (
        f"adds {min(ends[0]):.2f} to {max(ends[0]):.1f} px where `mcl-plan` adds "
        f"{min(ends[1]):.1f} to {max(ends[1]):.0f}"
    )
    weak = row("hedge/authors", "guided-estimate", "mcl-plan", where=_world(1, 100.0, 0.2))
    spec = "large noise it adds {diff:.0f} px ({diff_low:.0f} to {diff_high:.0f})"
    yield filled(spec, weak)


def _of_journeys() -> Iterable[str]:
    """Yield what it says of robots that are lost, kidnapped or driving."""

    def found(scenario: str, method: str, **params: object) -> Number:
        return Number(row("hedge/lost", scenario, method, 2000, **params)["success_1m"])

    right, wrong = (
        [
            found(scenario, "mcl-plan-hedged", plans="first"),
            found(scenario, "mcl-map", **DRAWS),
            found(scenario, "mcl-map"),
            found(scenario, "mcl-plan"),
            found(scenario, "mcl-plan-hedged"),
        ]
        for scenario in ("lost", "lost-wrong-route")
    )
    yield (
        f"as much as `start_draws` ({right[0]:.0p} and {right[1]:.0p} % localized, without a "
        f"route {right[2]:.0p} %)"
    )
    yield f"half as many as no route ({wrong[1]:.0p} %), its hedge {wrong[0]:.0p} %"
    points = [100 * (wrong[2] - share) for share in wrong[3:]]
    yield (
        f"costs `mcl-plan` {points[0]:.0f} points ({wrong[3]:.0p} %), the hedge {points[1]:.0f} "
        f"({wrong[4]:.0p} %)"
    )
    late = "metres_to_recover_diff"
    spec = f"{{{late}:.1f}} m%s ({{{late}_low:.1f}} to {{{late}_high:.1f}}"
    later = [
        filled(spec % more, row("hedge/lost", "kidnapped-stale", method, 2000))
        for method, more in (("mcl-plan", " later than `mcl-map`"), ("mcl-plan-hedged", ""))
    ]
    yield f"`mcl-plan` recovers {later[0]}), the hedge {later[1]}; not significant)"
    fewer: dict[str, list[float]] = {"mcl-plan": [], "mcl-plan-hedged": []}
    for method, points in fewer.items():
        for scenario in ("driving", "driving-route"):
            for many in (500, 2000):
                ends = (row("hedge/driving", scenario, m, many) for m in ("mcl-map", method))
                base, share = (100 * float(end["success"]) for end in ends)
                points.append(base - share)
    within = max(map(abs, fewer["mcl-plan-hedged"]))
    yield (
        f"arrives as often as `mcl-map`, within {within:.0f} points; `mcl-plan` in "
        f"{min(fewer['mcl-plan']):.0f} to {max(fewer['mcl-plan']):.0f} points fewer worlds"
    )
