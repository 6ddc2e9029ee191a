"""The tables of README and docs whose numbers come from ``docs/reports``.

``make docs-numbers`` writes each below its marker, ``<!-- numbers: NAME -->``, and names each
sentence of ``SENTENCES`` that the text does not have; a test fails if either differs. A cell is a
template, empty if the report has no such number. A row of a report is found by scenario and method;
of those with the parameters asked for, the one with the fewest.
"""

import csv
import functools
import json
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MARKER = re.compile(r"^(<!-- numbers: (.+) -->\n)((?:\|.*\n)*)", re.MULTILINE)

Cells = list[str]


class Number(float):
    """A number as texts write it: − for minus, "never" for infinity; ``.0p`` is per cent."""

    def __format__(self, spec: str) -> str:
        if math.isinf(self):
            return "never"
        text = f"{100 * self:{spec[:-1]}f}" if spec.endswith("p") else f"{float(self):{spec}}"
        if not text.strip("-0."):  # no minus before what rounds to zero
            text = text.replace("-", "+" if "+" in spec else "")
        return text.replace("-", "−")


def filled(template: str, row: Mapping[str, str]) -> str:
    """Return a template with a row's numbers; "" if the row lacks one."""
    names = re.findall(r"{(\w+)", template)
    if any(row.get(name, "") == "" for name in names):
        return ""
    text = template.format_map({name: Number(row[name]) for name in names})
    return text.replace(" (never to never)", "")


@functools.cache
def _rows(report: str) -> list[dict[str, str]]:
    with (ROOT / "docs" / "reports" / f"{report}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def row(
    report: str, scenario: str, method: str, particles: int | None = None, offset: int = 0,
    **params: object,
) -> dict[str, str]:  # fmt: skip
    """Return the row of a report for a method with these parameters."""

    def given(row: Mapping[str, str]) -> dict[str, object]:
        swept = json.loads(row["swept"]) if row.get("swept") else {}
        return {"particles": particles} | swept | json.loads(row["params"])

    wanted = params | ({} if particles is None else {"particles": particles})
    found = [
        r
        for r in _rows(report)
        if (r["scenario"], r["method"], r.get("offset", "0")) == (scenario, method, str(offset))
        and all(given(r).get(name) == value for name, value in wanted.items())
    ]
    if not found:
        raise LookupError(f"{report}.csv has no {method} {wanted} in {scenario}")
    return min(found, key=lambda r: len(r["params"]))


def _table(head: str, rows: Iterable[Cells]) -> str:
    """Return a table; a head that ends with ``:`` is of numbers."""
    heads = [cell.strip() for cell in head.split("|")]
    line = "|".join("---:" if cell.endswith(":") else "---" for cell in heads)
    lines = [[cell.removesuffix(":") for cell in heads], *rows]
    text = ["| " + " | ".join(cells) + " |" for cells in lines]
    text.insert(1, f"|{line}|")
    return "".join(re.sub(r"(?<=\|)  (?=\|)", " ", line) + "\n" for line in text)


def _bold(cells: Cells, *which: int) -> Cells:
    return [f"**{cell}**" if k in which else cell for k, cell in enumerate(cells)]


ROBOT = {"laser_model_type": "robot"}
AMCL, OWN = "`amcl`, Nav2's", "`amcl`, the models of all others"
SHARE = "{%s:.0p} %% ({%s_low:.0p} to {%s_high:.0p})"
SUCCESS = SHARE.replace("%s", "success_1m").replace("%%", "%")
RECOVERED = SHARE.replace("%s", "recovered").replace("%%", "%")
ARRIVED = SHARE.replace("%s", "success").replace("%%", "%")
METRES = "{metres_to_localize:.1f} ({metres_to_localize_low:.1f} to {metres_to_localize_high:.1f})"
DIFF_METRES = (
    "{metres_to_localize_diff:+.1f} "
    "({metres_to_localize_diff_low:.1f} to {metres_to_localize_diff_high:.1f})"
)
DIFF = "{diff:+.1f} ({diff_low:.1f} to {diff_high:.1f})"
DRAWS = {"start_draws": 20}


def _wrong(method: str, **params: object) -> str:
    """The difference if the plan is for another start."""
    return filled(DIFF, row("hedge/ends", "guided-stale", method, **params))


def _cost(scenario: str, method: str, particles: int) -> str:
    return filled("{cost:.1f} × `mcl-map`", row("hedge/costs", scenario, method, particles))


def _room() -> str:
    columns = ["{error:.1f} ({error_sd:.1f})", DIFF, "{lost_rate:.0p} %", "{ms_per_step:.2f}"]
    hedged = row("hedge/rooms", "guided", "mcl-plan-hedged", 300)
    rows = [
        [
            "**`mcl-plan-hedged`: each plan an observation, beside a filter that sees none**",
            *(filled(c, hedged) for c in columns[:2]),
            _wrong("mcl-plan-hedged"),
            filled(columns[2], hedged),
            _cost("guided", "mcl-plan-hedged", 300),
        ]
    ]
    labels = {
        "`mcl-plan`: each plan an observation": "mcl-plan",
        "`deq-mcl`, the paper's filter": "deq-mcl",
        "`deq-mcl-rejuvenated`, future renewed": "deq-mcl-rejuvenated",
        "`mcl-pilots`: looks ahead by roll-outs": "mcl-pilots",
        "`mcl-h`: looks ahead by a table": "mcl-h",
        "`mcl-map`: penalizes steps through walls": "mcl-map",
        "`mcl`, Monte-Carlo localization": "mcl",
    }
    for label, method in labels.items():
        cells = [filled(c, row("plan-sensor/results", "guided", method, 300)) for c in columns]
        wrong = "" if method.startswith("mcl-map") or method == "mcl" else _wrong(method)
        rows.append([label, *cells[:2], wrong, *cells[2:]])
    for label, params in (
        ("`amcl` with the scan and motion models of all others", ROBOT),
        ("`amcl`, Nav2's, with Nav2's defaults", {}),
    ):
        found = row("amcl/rooms", "guided", "amcl", **params)
        cost = filled("{cost:.1f} × `mcl-map`", row("amcl/costs", "guided", "amcl", **params))
        cells = [filled(c, found) for c in columns[:3]]
        rows.append([label, *cells[:2], "", cells[2], cost])
    still = [
        filled(c, row("plan-sensor/results", "guided", "dead-reckoning", 300)) for c in columns
    ]
    rows.append(["dead reckoning on the commands", *still[:2], "", *still[2:]])
    rows[0] = _bold(rows[0], 1, 3)
    head = "method | error, px (SD): | error − that of `mcl-map`, 95 % interval:"
    return _table(f"{head} | with a plan for another start: | lost: | ms per step:", rows)


def _lost_in_short() -> str:
    columns = [SUCCESS, METRES, "{ms_per_step:.1f}"]
    rows = [
        [label, *(filled(c, row("lost/results", "lost", method, n, **params)) for c in columns)]
        for label, method, n, params in (
            (
                "MCL with random poses when scans fit badly, without the route",
                "mcl-map", 10_000, {},
            ),
            ("the same, N = 50,000", "mcl-map", 50_000, {}),
            (
                "the route used once, at the start: 20 poses drawn for each particle",
                "mcl-map", 10_000, DRAWS,
            ),
            ("the route as evidence at every step", "mcl-plan", 10_000, {}),
        )
    ]  # fmt: skip
    rows[2] = _bold(rows[2], 1, 2)
    for label, params in (
        ("`amcl` with the models of all others, at most 20,000 particles, with recovery", ROBOT),
        ("`amcl`, Nav2's, the same", {}),
    ):
        found = row("amcl/lost", "lost", "amcl", **params)
        cost = filled("{cost:.1f} × the first", row("amcl/costs", "lost", "amcl", **params))
        rows.append([label, *(filled(c, found) for c in columns[:2]), cost])
    head = "method, N = 10,000 | localized to the end (1 m, 30°):"
    return _table(f"{head} | metres driven until then, median: | ms per step:", rows)


PRINTED = {  # Taniguchi, Fukawa & Yamakawa 2024, Table 1: error (SD), entropy
    "mcl": ("26.17 (22.00)", "9.81", ("966.93", "591.79", "0.19", "0.16")),
    "mcl-smoother": ("22.88 (20.01)", "8.88", ("977.39", "611.06", "0.14", "0.11")),
    "mcl-map": ("25.00 (18.38)", "9.69", ("792.28", "616.85", "0.17", "0.16")),
    "deq-mcl": ("20.95 (17.66)", "7.82", ("419.92", "290.04", "0.09", "0.07")),
}
OFFSETS = {0: "x[t]", -20: "x[t-20]", 20: "x[t+20]"}
INTERVAL = "{diff:+.2f} [{diff_low:+.2f}, {diff_high:+.2f}]"


def _plain(text: str) -> str:
    return text.replace("−", "-")


def _table_1() -> str:
    rows = []
    for method, offset in (
        ("mcl", 0), ("mcl-smoother", -20), ("mcl-map", 0), ("mcl-map-smoother", -20),
        ("deq-mcl", 0), ("deq-mcl", -20), ("dead-reckoning", 0),
    ):  # fmt: skip
        found = row("paper/results", "paper", method, offset=offset)
        error, entropy, _ = PRINTED.get(method, ("", "", ()))
        ours = filled("{error:.2f} ({error_sd:.2f})", found)
        nats = _plain(filled("{entropy:.2f}", found)) or "n/a"
        rows.append([f"`{method}`", OFFSETS[offset], ours, error, nats, entropy])
        rows[-1].append(_plain(filled(INTERVAL, found)))
    head = "method | belief about | error (SD): | paper: | entropy: | paper: | error - `mcl`'s,"
    return _table(f"{head} 95 % interval:", rows)


def _paper_200(scenario: str) -> str:
    rows = []
    for found in _rows(f"paper-200/{scenario}"):
        method, offset = found["method"], int(found["offset"])
        error, entropy, printed = (
            PRINTED.get(method, ("", "", ("",) * 4)) if offset <= 0 else ("", "", ("",) * 4)
        )
        digits = {"var_x": ".1f", "var_y": ".1f", "var_cos": ".3f", "var_sin": ".3f"}
        ours = [filled(f"{{{name}:{spec}}}", found) or "n/a" for name, spec in digits.items()]
        cells = [
            f"`{method}`",
            OFFSETS[offset],
            filled(INTERVAL, found) or "baseline",
            filled("{error:.2f} ({error_sd:.2f})", found),
            error,
            filled("{entropy:.2f}", found) or "n/a",
            entropy,
            filled("{wall_share:.1p} %", found),
            *(cell for pair in zip(ours, printed, strict=True) for cell in pair),
        ]
        rows.append([_plain(cell) for cell in cells])
    head = "method | of | error - `mcl`'s, 95 %: | error (SD): | paper: | entropy: | paper: | "
    more = "".join(f" | var {part}: | paper:" for part in ("x", "y", "cos θ", "sin θ"))
    return _table(f"{head}in walls:{more}", rows)


def _every_method(scenario: str, order: Mapping[str, tuple[str, dict[str, object]]]) -> str:
    inside = ["{coverage_50:.0p} %", "{coverage_95:.0p} %"]
    late = [*inside, "{nees:.1f} ({nees_low:.1f} to {nees_high:.1f})"]
    rows = []
    for label, (method, params) in order.items():
        if method == "amcl":
            found = row("amcl/rooms", scenario, method, **params)
            cells = [filled("{error:.1f}", found), filled(DIFF, found), "", ""]
            rows.append([label, *cells, *(filled(c, found) for c in late), ""])
            continue
        hedged = method == "mcl-plan-hedged"
        report = "hedge/rooms" if hedged else "plan-sensor/results"
        few, many = (row(report, scenario, method, n, **params) for n in (300, 1000))
        cells = [filled(c, found) for found in (few, many) for c in ("{error:.1f}", DIFF)]
        if hedged:
            cost = _cost(scenario, method, 1000)
            rows.append([label, *cells, *(filled(c, many) for c in late), cost])
            continue
        rows.append([label, *cells, *(filled(c, many) for c in (*late, "{ms_per_step:.2f}"))])
    head = "method | error, N = 300: | difference: | error, N = 1,000: | difference: | inside 50 %:"
    return _table(f"{head} | inside 95 %: | NEES (3): | ms per step:", rows)


def _methods(*labels: str) -> dict[str, tuple[str, dict[str, object]]]:
    known = {
        "`mcl-plan`, `keep` = 0": ("mcl-plan", {"keep": 0.0}),
        '`mcl-plan`, `charge` = "new"': ("mcl-plan", {"charge": "new"}),
        "dead reckoning": ("dead-reckoning", {}),
        OWN: ("amcl", ROBOT),
        AMCL: ("amcl", {}),
    }
    return {label: known.get(label, (label.strip("`"), {})) for label in labels}


IN_GUIDED = _methods(
    "`mcl-plan`, `keep` = 0", '`mcl-plan`, `charge` = "new"', "`mcl-plan`", "`mcl-plan-hedged`",
    "`deq-mcl-rejuvenated`", "`deq-mcl`", "`mcl-pilots`", "`mcl-h`", "`mcl-map`", "`mcl`", "`grid`",
    OWN, "`ekf`", AMCL, "dead reckoning",
)  # fmt: skip
IN_PAPER = _methods(
    "dead reckoning", "`mcl-plan`", "`mcl-plan`, `keep` = 0", "`mcl-plan-hedged`",
    '`mcl-plan`, `charge` = "new"',
    "`deq-mcl-rejuvenated`", "`mcl-h`", "`mcl-pilots`", "`mcl-map`", "`deq-mcl`", "`mcl`", OWN,
    "`grid`", "`ekf`", AMCL,
)  # fmt: skip


def _no_harm() -> str:
    rows = []
    for scenario, digits in (("sharp", 3), ("matched", 2)):
        for n in (300, 1000):
            base, plan = (
                row("matched-sharp/results", scenario, method, n)
                for method in ("mcl-map", "mcl-plan")
            )
            hedged = row("hedge/harmless", scenario, "mcl-plan-hedged", n)
            more = f"{{diff:+.{digits}f}} ({{diff_low:.{digits}f}} to {{diff_high:.{digits}f}})"
            share = "{relative:+.1p} % ({relative_low:.1p} to {relative_high:.1p})"
            cells = [filled(c, found) for found in (plan, hedged) for c in (more, share)]
            error = filled(f"{{error:.{digits}f}}", base)
            rows.append([f"`{scenario}`", f"{n:,}", error, *cells])
    head = " | N: | `mcl-map`: | `mcl-plan`, difference: | of the error:"
    return _table(f"{head} | `mcl-plan-hedged`, difference: | of the error:", rows)


SENSORS = ((1, 100.0, "weak"), (9, 50.0, "middle"), (9, 5.0, "sharp"))
NOISES = ((0.02, "small"), (0.2, "large"))
AUTHORS = {
    "guided": "from the true pose, at every step (`guided`)",
    "guided-before": "before the start (`guided-before`)",
    "guided-estimate": "from the localizer's estimate (`guided-estimate`)",
    "guided-stale": "for another start (`guided-stale`)",
}


def _in_world(report: str, beams: int, sigma: float, noise: float) -> list[dict[str, str]]:
    """The rows of a report for a sensor and a noise of the motion, of the present."""

    def holds(row: Mapping[str, str]) -> bool:
        world = json.loads(row["world"])
        given = world["lidar.beams"], world["lidar.sigma"], world["noise.drive"]
        return given == (beams, sigma, noise) and row.get("offset", "0") == "0"

    return [row for row in _rows(report) if holds(row)]


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
                world = _in_world("hedge/authors", beams, sigma, noise)
                by = {r["method"]: r for r in world if r["scenario"] == scenario}
                base = filled("{error:.1f}", by["mcl-map"])
                cells = [_shown(by[method]) for method in ("mcl-plan", "mcl-plan-hedged")]
                rows.append([first, f"{sensor}, {size}", base, *cells])
                first = ""
    head = "the plan was made … | sensor, noise | `mcl-map`, px: | `mcl-plan`:"
    return _table(f"{head} | `mcl-plan-hedged`:", rows)


def _stale() -> str:
    rows = []
    kinds = (("mcl-map", 300), ("mcl-map", 150), ("mcl-plan-hedged", 300), ("mcl-plan-hedged", 600))
    for beams, sigma, sensor in SENSORS:
        for noise, size in NOISES:
            world = _in_world("hedge/stale", beams, sigma, noise)
            by = {(r["method"], json.loads(r["params"])["particles"]): r for r in world}
            rows.append([f"{sensor}, {size}", *(filled("{error:.2f}", by[kind]) for kind in kinds)])
    head = "sensor, noise | `mcl-map`, N = 300: | `mcl-map`, N = 150:"
    return _table(f"{head} | hedged, N = 150 + 150: | hedged, N = 300 + 300:", rows)


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
        cost = filled("{cost:.2g}", row("hedge/costs", "equal-time", method, n))
        rows.append([label, filled("{error:.2f}", found), filled(spec, found), cost])
    return _table(" | error: | difference, 95 % interval: | time per step / `mcl-map`'s:", rows)


def _signals() -> str:
    rows = []
    for beams, sigma, sensor in SENSORS:
        for noise, size in NOISES:
            found = {
                (r["method"], r["signal"]): filled(
                    "{auroc:.2f} ({auroc_low:.2f} to {auroc_high:.2f})", r
                )
                for r in _in_world("hedge/authors-plans", beams, sigma, noise)
            }
            plan = ("feasible", "log_evidence", "log_evidence_20", "tempering", "quality")
            cells = [found["mcl-plan", name] for name in plan]
            cells += [found["mcl-plan-hedged", name] for name in ("trusted", "trusted_lap")]
            rows.append([f"{sensor}, {size}", *cells])
    head = " | feasible share: | log-evidence: | its mean over 20 steps: | λ:"
    return _table(f"{head} | quality (scans alone): | trust, q: | its least in a lap:", rows)


def _ends() -> str:
    labels = {
        "`mcl-plan-hedged`": ("mcl-plan-hedged", {}),
        "`mcl-plan`": ("mcl-plan", {}),
        "`mcl-plan`, `keep` = 0": ("mcl-plan", {"keep": 0.0}),
        "`deq-mcl`": ("deq-mcl", {}),
        "`deq-mcl-rejuvenated`": ("deq-mcl-rejuvenated", {}),
        "`mcl-h`": ("mcl-h", {}),
        "`mcl-pilots`": ("mcl-pilots", {}),
    }
    rows = [
        [
            label,
            *(
                _shown(row("hedge/ends", scenario, method, **params))
                for scenario in ("guided", "guided-stale")
            ),
        ]
        for label, (method, params) in labels.items()
    ]
    return _table("method | the plan is right (`guided`): | for another start:", rows)


def _variants() -> str:
    scenarios = ("guided", "paper", "guided-stale", "guided-before")
    labels = {"`mcl-plan`, `keep` = 0": ("keep", 0.0)}
    labels |= {f"s = {s:g}": ("switching", s) for s in (0.0001, 0.001, 0.01, 0.05, 0.1)}
    labels["s = 0.001, `mutual`"] = "mutual", True
    found = {
        (r["scenario"], name, value): r
        for r in _rows("hedge/variants")
        for name, value in json.loads(r["params"]).items()
        if r["offset"] == "0"
    }
    rows = [
        [label, *(_shown(found[s, *kind]) for s in scenarios)] for label, kind in labels.items()
    ]
    return _table(" | " + " | ".join(f"`{s}`:" for s in scenarios), rows)


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
    return _table(f"{head} | difference in metres: | false commitment:", rows)


def _hedged_driving() -> str:
    rows = []
    for scenario in ("driving", "driving-route"):
        for n in (500, 2000):
            for method in ("mcl-map", "mcl-plan", "mcl-plan-hedged"):
                found = row("hedge/driving", scenario, method, n)
                cells = [filled(c, found) for c in (ARRIVED, "{spl:.2f}", "{contacts:.1f}")]
                first = f"`{scenario}`" if method == "mcl-map" and n == 500 else ""
                rows.append([first, f"{n:,}", f"`{method}`", *cells])
    return _table("scenario | N: | method | arrived without contact: | SPL: | contacts:", rows)


def _lost() -> str:
    columns = [SUCCESS, METRES, DIFF_METRES, "{false_commitment:.0p} %"]
    rows = []
    for n in (2000, 10_000, 50_000):
        for label, method, params in (
            ("`mcl`", "mcl", {}), ("`mcl-map`", "mcl-map", {}),
            ("… with `start_draws`", "mcl-map", DRAWS), ("`mcl-plan`", "mcl-plan", {}),
        ):  # fmt: skip
            if n == 50_000 and label != "`mcl-map`":
                continue
            found = row("lost/results", "lost", method, n, **params)
            cells = [label, f"{n:,}", *(filled(c, found) for c in (*columns, "{ms_per_step:.1f}"))]
            if label == "`mcl-map`" and n < 50_000:
                cells[4] = "baseline"
            rows.append(_bold(cells, 2) if params else cells)
    for label, params in ((OWN, ROBOT), (AMCL, {})):
        found = row("amcl/lost", "lost", "amcl", **params)
        cost = filled("{cost:.2f} ×", row("amcl/costs", "lost", "amcl", **params))
        rows.append([label, "≤ 20,000", *(filled(c, found) for c in columns), cost])
    head = "method | N: | localized to the end (1 m, 30°): | metres until then, median:"
    more = "difference in metres (restricted mean): | false commitment: | ms per step:"
    return _table(f"{head} | {more}", rows)


THREE = (("`mcl-map`", "mcl-map", {}), ("… with `start_draws`", "mcl-map", DRAWS),
         ("`mcl-plan`", "mcl-plan", {}))  # fmt: skip


def _lost_hard() -> str:
    columns = [SUCCESS, METRES, DIFF_METRES, "{false_commitment:.0p} %"]
    rows = []
    confirmed = {("lost-weak", 2): (4,), ("lost-symmetric", 1): (2, 4)}
    for scenario in ("lost-weak", "lost-symmetric", "lost-symmetric-route"):
        for k, (label, method, params) in enumerate(THREE):
            found = row("lost-hard/results", scenario, method, **params)
            cells = ["" if k else f"`{scenario}`", label, *(filled(c, found) for c in columns)]
            cells[4] = cells[4] or "baseline"
            rows.append(_bold(cells, *confirmed.get((scenario, k), ())))
    head = "scenario | method | localized to the end (1 m, 30°): | metres until then, median:"
    return _table(f"{head} | difference in metres: | false commitment:", rows)


def _kidnapped() -> str:
    columns = [RECOVERED, *(c.replace("localize", "recover") for c in (METRES, DIFF_METRES))]
    confirmed = {
        ("kidnapped", 2000, 1): (3,), ("kidnapped", 10_000, 1): (3,),
        ("kidnapped-stale", 2000, 2): (5,), ("kidnapped-stale", 10_000, 2): (3, 5),
    }  # fmt: skip
    rows = []
    for scenario in ("kidnapped", "kidnapped-stale"):
        for n in (2000, 10_000):
            for k, (label, method, params) in enumerate(THREE):
                found = row("kidnapped/results", scenario, method, n, **params)
                first = "" if k or n > 2000 else f"`{scenario}`"
                cells = [first, label, f"{n:,}", *(filled(c, found) for c in columns)]
                cells[5] = cells[5] or "baseline"
                rows.append(_bold(cells, *confirmed.get((scenario, n, k), ())))
        for label, params in ((OWN, ROBOT), (AMCL, {})) if scenario == "kidnapped" else ():
            found = row("amcl/lost", scenario, "amcl", **params)
            rows.append(["", label, "≤ 20,000", *(filled(c, found) for c in columns)])
    head = "scenario | method | N: | recovered: | metres until then, median:"
    return _table(f"{head} | difference in metres:", rows)


def _driving() -> str:
    def cells(first: str, label: str, n: str, found: dict[str, str], *bold: int) -> Cells:
        contacts = "{contacts:.1f}" if float(found["contacts"]) < 20 else "{contacts:.0f}"
        columns = (ARRIVED, "{spl:.2f}", contacts)
        return _bold([first, label, n, *(filled(c, found) for c in columns)], *bold)

    def of(scenario: str, method: str, n: int) -> dict[str, str]:
        return row("driving/results", scenario, method, n)

    rows = []
    for n in (500, 2000):
        for k, method in enumerate(("mcl-map", "mcl", "mcl-plan")):
            first = "" if k or n > 500 else "`driving`: its own plan"
            found = of("driving", method, n)
            rows.append(cells(first, f"`{method}`", f"{n:,}", found, *((3,) if k == 2 else ())))
    rows.append(cells("", AMCL, "≤ 2,000", row("amcl/driving", "driving", "amcl"), 3))
    rows.append(cells("", OWN, "≤ 2,000", row("amcl/driving", "driving", "amcl", **ROBOT)))
    rows.append(cells("", "dead reckoning", "", of("driving", "dead-reckoning", 2000), 3))
    route = "`driving-route`: a dispatcher's route"
    rows.append(cells(route, "`mcl-map`", "2,000", of("driving-route", "mcl-map", 2000)))
    rows.append(cells("", "`mcl-plan`", "2,000", of("driving-route", "mcl-plan", 2000), 3))
    for name, words in (
        ("perfect", "the true pose"),
        ("blind", "the initial plan, without feedback"),
    ):
        found = of(f"driving-{name}", "mcl-map", 2000)
        rows.append(cells(f"`driving-{name}`: {words}", "", "", found))
    return _table("scenario | method | N: | arrived without contact: | SPL: | contacts:", rows)


def _gaps() -> str:
    rows = []
    for label, method, params, limit, limit_params, offsets in (
        ("`mcl`", "mcl", {}, "mcl-smoother", {}, (0,)),
        ("`mcl-smoother`", "mcl-smoother", {}, "mcl-smoother", {}, (-20,)),
        ("`mcl-map`", "mcl-map", {}, "mcl-map-smoother", {}, (0,)),
        ("`mcl-map-smoother`", "mcl-map-smoother", {}, "mcl-map-smoother", {}, (-20,)),
        ("`mcl-pilots`", "mcl-pilots", {}, "mcl-pilots", {}, (0, -20)),
        ("`mcl-h`", "mcl-h", {}, "mcl-pilots", {}, (0, -20)),
        ("`deq-mcl-rejuvenated`", "deq-mcl-rejuvenated", {}, "mcl-pilots", {}, (0, -20)),
        ("`deq-mcl`", "deq-mcl", {}, "mcl-pilots", {}, (0, -20)),
        ("`mcl-plan keep=0`", "mcl-plan", {"keep": 0.0}, "mcl-plan", {}, (0, -20)),
        ("`mcl-plan` (`keep` = 0.8)", "mcl-plan", {}, "mcl-plan", {}, (0, -20)),
        ("`mcl-plan charge=new`", "mcl-plan", {"charge": "new"}, "mcl-plan", {}, (0,)),
    ):
        for offset in offsets:
            cells = []
            for scenario in ("paper", "guided"):
                best = row("plan-sensor/gaps", scenario, limit, 100_000, offset, **limit_params)
                cells.append(filled("{error:.2f}", best))
                for n in (300, 1000):
                    found = row("plan-sensor/gaps", scenario, method, n, offset, **params)
                    gap = "{gap:+.2f} ({gap_low:.2f} to {gap_high:.2f})"
                    cells.append(filled(gap, found))
            rows.append([label, OFFSETS[offset], *cells])
    ends = "gap, N = 300: | N = 1000:"
    head = f"method | belief about | `paper`: limit: | {ends} | `guided`: limit: | {ends}"
    return _table(head, rows)


def _calibration() -> str:
    columns = [SHARE.replace("%s", f"coverage_{p}").replace("%%", "%") for p in (50, 80, 95)]
    columns.append("{nees:.1f} ({nees_low:.1f} to {nees_high:.1f})")
    rows = []
    for label, (method, params) in _methods(
        "`grid`", OWN, "`ekf`", "`mcl`", "`mcl-map`", "`deq-mcl`", "`deq-mcl-rejuvenated`",
        "`mcl-h`", "`mcl-pilots`",
    ).items():  # fmt: skip
        if method == "amcl":
            cells = [""] * 4
            guided = row("amcl/rooms", "guided", method, **params)
        else:
            matched = row("matched-sharp/results", "matched", method, 1000)
            cells = [filled(c, matched) for c in columns]
            guided = row("plan-sensor/results", "guided", method, 1000)
        rows.append([label, *cells, *(filled(c, guided) for c in columns)])
    shares = "inside 50 % | 80 % | 95 % | NEES"
    return _table(f"method | `matched`: {shares} | `guided`: {shares}", rows)


def _two_buildings() -> str:
    rows = []
    for building, length in (("freiburg-079", 392), ("intel", 504)):
        for k, (label, file, method) in enumerate((
            ("`mcl`", building, "mcl"),
            ("`mcl-map`", building, "mcl-map"),
            ("`amcl`", building, "amcl"),
            ("`amcl`, each 0.0625 m, 3°", f"{building}-amcl", "amcl"),
            ("… `likelihood_field_prob`", f"{building}-likelihood-field-prob", "amcl"),
        )):  # fmt: skip
            (found,) = (r for r in _rows(f"buildings/{file}") if r["localizer"] == method)
            runs = int(found["seeds"])
            degrees = {"heading": str(math.degrees(float(found["heading_median"])))}
            rows.append([
                "" if k else f"{building}, {length} m",
                label,
                *(filled(c, found) for c in ("{position_median:.3f} m", "{position_p95:.3f} m")),
                filled("{heading:.2f}°", degrees),
                f"{runs * float(found['success_1m']):.0f} of {runs}",
                filled("{within_1m:.0p} %", found),
                f"{runs * float(found['lost']):.0f} of {runs}",
                filled("{coverage_50:.0p}, {coverage_95:.0p} %", found),
                filled("{nees:.1f}" if float(found["nees"]) < 100 else "{nees:,.0f}", found),
            ])  # fmt: skip
    head = "building | localizer | position, median: | 95 %: | heading, median:"
    more = "success (1 m, 30°): | within 1 m, 30°: | lost: | inside 50, 95 %: | NEES (3):"
    return _table(f"{head} | {more}", rows)


def _starts() -> str:
    rows = []
    for k, found in enumerate(_rows("buildings/starts")):
        first, label = found["building"], "`mcl-map`, without the plan"
        if k % 2:
            first, label = "", "… with `start_draws`"
        cells = [first, label, *(filled(c, found) for c in (SUCCESS, METRES, DIFF_METRES))]
        cells[4] = cells[4] or "baseline"
        rows.append(_bold(cells, *{1: (2, 4), 3: (4,)}.get(k, ())))
    head = "building | localizer | localized to the end (1 m, 30°): | metres to localize, median:"
    return _table(f"{head} | difference in metres (restricted mean):", rows)


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
    return _table(f"{head} | difference in metres (restricted mean):", rows)


TABLES = {
    "plan-sensor, in short": _room,
    "lost, in short": _lost_in_short,
    "paper": _table_1,
    "paper-200, paper": lambda: _paper_200("paper"),
    "paper-200, matched": lambda: _paper_200("matched"),
    "paper-200, sharp": lambda: _paper_200("sharp"),
    "plan-sensor, guided": lambda: _every_method("guided", IN_GUIDED),
    "plan-sensor, paper": lambda: _every_method("paper", IN_PAPER),
    "matched-sharp": _no_harm,
    "hedge, authors": _authors,
    "hedge, stale": _stale,
    "hedge, equal time": _equal_time,
    "hedge, signals": _signals,
    "hedge, ends": _ends,
    "hedge, variants": _variants,
    "hedge, lost": _hedged_lost,
    "hedge, driving": _hedged_driving,
    "lost": _lost,
    "lost-hard": _lost_hard,
    "kidnapped": _kidnapped,
    "driving": _driving,
    "plan-sensor, gaps": _gaps,
    "calibration": _calibration,
    "buildings": _two_buildings,
    "buildings, starts": _starts,
    "hedge, starts": _hedged_starts,
}


def _of_the_hedge(halved: str) -> Iterable[tuple[str, str]]:
    """Yield what the page of the plan as a sensor says at its head."""
    yield (
        "docs/plan-sensor.md",
        filled(halved, row("hedge/rooms", "guided", "mcl-plan-hedged", 300)),
    )
    kept = [
        float(row("hedge/rooms", scenario, "mcl-plan-hedged", many)["diff"])
        / float(row("hedge/rooms", scenario, "mcl-plan", many)["diff"])
        for scenario in ("guided", "paper")
        for many in (300, 1000)
    ]
    yield "docs/plan-sensor.md", f"keeps {100 * min(kept):.0f} to {100 * max(kept):.0f} % of what"
    authors = {
        (r["scenario"], r["world"], r["method"]): r
        for r in _rows("hedge/authors")
        if r["offset"] == "0" and r["diff"]
    }
    stale = [
        float(r["diff"])
        for (scenario, _, method), r in authors.items()
        if (scenario, method) == ("guided-stale", "mcl-plan")
    ]
    yield "docs/plan-sensor.md", f"adds {min(stale):.1f} to {max(stale):.0f} px with every sensor"
    wrong = [
        (key, r) for key, r in authors.items() if key[0] != "guided" and key[2] == "mcl-plan-hedged"
    ]
    harmed = [key for key, r in wrong if _shown(r).startswith("**+")]
    yield (
        "docs/plan-sensor.md",
        f"no harm was found in {len(wrong) - len(harmed)} of {len(wrong)} settings",
    )
    ends = [
        [float(authors[key[0], key[1], method]["diff"]) for key in harmed]
        for method in ("mcl-plan-hedged", "mcl-plan")
    ]
    yield (
        "docs/plan-sensor.md",
        f"adds {min(ends[0]):.2f} to {max(ends[0]):.1f} px where `mcl-plan` adds "
        f"{min(ends[1]):.1f} to {max(ends[1]):.0f}",
    )
    weak = next(
        r
        for r in _in_world("hedge/authors", 1, 100.0, 0.2)
        if (r["scenario"], r["method"]) == ("guided-estimate", "mcl-plan")
    )
    spec = "large noise it adds {diff:.0f} px ({diff_low:.0f} to {diff_high:.0f})"
    yield "docs/plan-sensor.md", filled(spec, weak)


def sentences() -> Iterable[tuple[str, str]]:
    """Yield pages and what they must say, word for word."""

    def n(
        field: str, report: str, scenario: str, method: str, many: int | None = None, **p: object
    ):
        return Number(row(report, scenario, method, many, **p)[field])

    def building(name: str, field: str) -> Number:
        return Number(next(r for r in _rows(f"buildings/{name}") if r["localizer"] == "mcl")[field])

    sensor, kidnapped = "plan-sensor/results", "kidnapped/results"
    base, plan = (n("error", sensor, "paper", name, 300) for name in ("mcl-map", "mcl-plan"))
    deq = n("error", sensor, "paper", "deq-mcl", 300)
    yield "README.md", f"has the same {n('error', 'amcl/rooms', 'guided', 'mcl-map'):.1f} px"
    yield "README.md", f"{plan:.1f} px, `mcl-map` {base:.1f}, the paper's filter {deq:.1f} (N"
    yield "README.md", f"with 1,000 has {n('error', sensor, 'guided', 'mcl-plan', 1000):.1f}"
    gained = [-n("diff", sensor, "paper", "mcl-plan", many) for many in (300, 1000)]
    yield (
        "docs/reports/paper-200.md",
        f"`mcl-plan` is better by {gained[0]:.1f} and {gained[1]:.1f}.",
    )
    shares = [
        -n("diff", sensor, "paper", method, many)
        for method in ("deq-mcl-rejuvenated", "mcl-h", "mcl-pilots")
        for many in (300, 1000)
    ]
    yield (
        "docs/reports/paper-200.md",
        f"`mcl-map` by {min(shares):.1f} to {max(shares):.1f}, at N = 300",
    )
    over_200 = filled(INTERVAL, row("paper-200/paper", "paper", "deq-mcl"))
    yield "README.md", _plain(f"than MCL ({over_200})").replace("+", "")
    yield "README.md", f"has the same {n('success_1m', 'amcl/lost', 'lost', 'mcl-map'):.0p} %"
    new, none = (n("recovered", kidnapped, "kidnapped", "mcl-map", 2000, **p) for p in (DRAWS, {}))
    yield "README.md", f"recovers in {new:.0p} % of 100 worlds instead of {none:.0p} % (N = 2,000)"
    late = n("metres_to_recover_diff", kidnapped, "kidnapped-stale", "mcl-plan", 2000)
    yield "README.md", f"needs {late:.0f} m more than without a route"
    medians, inside = (
        [building(name, field) for name in ("freiburg-079", "intel")]
        for field in ("position_median", "coverage_95")
    )
    yield "README.md", f"median error of {medians[0]:.3f} and {medians[1]:.3f} m and is never lost"
    yield "README.md", f"region covers {inside[0]:.0p} and {inside[1]:.0p} % of the reference"
    starts = [Number(r["success_1m"]) for r in _rows("buildings/starts")]
    yield (
        "README.md",
        f"{starts[0]:.0p} and {starts[2]:.0p} % are localized without the plan, "
        f"{starts[1]:.0p} and {starts[3]:.0p} % if it is used once",
    )
    yield (
        "docs/lost.md",
        f"{starts[1]:.0p} % instead of {starts[0]:.0p} % and {starts[3]:.0p} % instead of "
        f"{starts[2]:.0p} %",
    )
    yield "docs/lost.md", f"has the same {n('success', 'amcl/driving', 'driving', 'mcl-map'):.0p} %"
    weak = [n("success_1m", "lost-hard/results", "lost-weak", m) for m in ("mcl-plan", "mcl-map")]
    yield "docs/lost.md", f"{weak[0]:.0p} % localized instead of {weak[1]:.0p} %"
    of = n("error", sensor, "guided", "mcl-map", 300)
    halved = f"({{diff:.1f}} px of {of:.1f}; 95 % interval {{diff_low:.1f}} to {{diff_high:.1f}})"
    yield "docs/plan-sensor.md", filled(halved, row(sensor, "guided", "mcl-plan", 300))
    yield from _of_the_hedge(halved)
    speed = {r["figure"]: Number(r["ratio"]) for r in _rows("speed/speed") if r["ratio"]}
    many = [
        (speed[f"{name}_vs_map_step1k"], speed[f"{name}_vs_map_step10k"])
        for name in ("plan", "replanned_pilots", "replanned_deq", "replanned_h")
    ]
    words = [f"{a:.1f} and {b:.1f}" if a < 10 else f"{a:.0f} and {b:.0f}" for a, b in many]
    names = ("`mcl-plan`", "`mcl-pilots`", "DEQ-MCL", "`mcl-h`")
    yield (
        "docs/plan-sensor.md",
        ", ".join(f"{name} {ratio}" for name, ratio in zip(names, words, strict=True)),
    )


def renewed(text: str) -> str:
    """Return a text with the table below each of its markers made anew."""
    return MARKER.sub(lambda found: found[1] + TABLES[found[2]](), text)


def pages() -> list[Path]:
    """Return the pages that may have markers."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def main() -> None:
    """Write the tables; name the sentences that the pages lack."""
    for page in pages():
        before = page.read_text(encoding="utf-8")
        if (text := renewed(before)) != before:
            page.write_text(text, encoding="utf-8")
            print(f"written: {page.relative_to(ROOT)}")
    for page, sentence in sentences():
        if sentence not in (ROOT / page).read_text(encoding="utf-8"):
            print(f"{page} should say: {sentence}")


if __name__ == "__main__":
    main()
