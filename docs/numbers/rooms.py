"""The tables of rooms: every method, the paper's experiment, limits, calibration."""

import json
from collections.abc import Mapping

from docs.numbers.reading import (
    AMCL,
    DIFF,
    INTERVAL,
    OWN,
    ROBOT,
    SHARE,
    filled,
    in_bold,
    plain,
    read,
    row,
    table,
)


def _wrong(method: str, **params: object) -> str:
    """The difference if the plan is for another start."""
    return filled(DIFF, row("hedge/ends", "guided-stale", method, **params))


def _cost(scenario: str, method: str, particles: int) -> str:
    return filled("{cost:.1f} × `mcl-map`", row("hedge/rooms", scenario, method, particles))


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
        "`mcl-map`: penalizes steps through walls": "mcl-map",
        "`mcl`, Monte-Carlo localization": "mcl",
    }
    for label, method in labels.items():
        cells = [filled(c, row("plan-sensor/results", "guided", method, 300)) for c in columns]
        wrong = "" if method.startswith("mcl-map") or method == "mcl" else _wrong(method)
        rows.append([label, *cells[:2], wrong, *cells[2:]])
    ahead = next(r for r in read("speed/quick") if r["figure"] == "replanned_fresh_vs_map_step1k")
    fresh = row("queue/fresh", "guided", "deq-mcl-fresh", 300)
    rows.insert(
        3,
        [
            "`deq-mcl-fresh`, its future drawn anew after each scan",
            *(filled(c, fresh) for c in columns[:2]),
            filled(DIFF, row("queue/fresh", "guided-stale", "deq-mcl-fresh", 300)),
            filled(columns[2], fresh),
            filled("{ratio:.0f} × `mcl-map`", ahead),
        ],
    )
    for label, params in (
        ("`amcl` with the scan and motion models of all others", ROBOT),
        ("`amcl`, Nav2's, with Nav2's defaults", {}),
    ):
        found = row("amcl/rooms", "guided", "amcl", **params)
        cost = filled("{cost:.1f} × `mcl-map`", row("amcl/rooms", "guided", "amcl", **params))
        cells = [filled(c, found) for c in columns[:3]]
        rows.append([label, *cells[:2], "", cells[2], cost])
    still = [
        filled(c, row("plan-sensor/results", "guided", "dead-reckoning", 300)) for c in columns
    ]
    rows.append(["dead reckoning on the commands", *still[:2], "", *still[2:]])
    rows[0] = in_bold(rows[0], 1, 3)
    head = "method | error, px (SD): | error − that of `mcl-map`, 95 % interval:"
    return table(f"{head} | with a plan for another start: | lost: | ms per step:", rows)


PRINTED = {  # Taniguchi, Fukawa & Yamakawa 2024, Table 1: error (SD), entropy
    "mcl": ("26.17 (22.00)", "9.81", ("966.93", "591.79", "0.19", "0.16")),
    "mcl-smoother": ("22.88 (20.01)", "8.88", ("977.39", "611.06", "0.14", "0.11")),
    "mcl-map": ("25.00 (18.38)", "9.69", ("792.28", "616.85", "0.17", "0.16")),
    "deq-mcl": ("20.95 (17.66)", "7.82", ("419.92", "290.04", "0.09", "0.07")),
}
OFFSETS = {0: "x[t]", -20: "x[t-20]", 20: "x[t+20]"}


def _table_1() -> str:
    rows = []
    for method, offset in (
        ("mcl", 0), ("mcl-smoother", -20), ("mcl-map", 0), ("mcl-map-smoother", -20),
        ("deq-mcl", 0), ("deq-mcl", -20), ("dead-reckoning", 0),
    ):  # fmt: skip
        found = row("paper/results", "paper", method, offset=offset)
        error, entropy, _ = PRINTED.get(method, ("", "", ()))
        ours = filled("{error:.2f} ({error_sd:.2f})", found)
        nats = plain(filled("{entropy:.2f}", found)) or "n/a"
        rows.append([f"`{method}`", OFFSETS[offset], ours, error, nats, entropy])
        rows[-1].append(plain(filled(INTERVAL, found)))
    head = "method | belief about | error (SD): | paper: | entropy: | paper: | error - `mcl`'s,"
    return table(f"{head} 95 % interval:", rows)


def _paper_200(scenario: str) -> str:
    rows = []
    for found in read(f"paper-200/{scenario}"):
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
        rows.append([plain(cell) for cell in cells])
    head = "method | of | error - `mcl`'s, 95 %: | error (SD): | paper: | entropy: | paper: | "
    more = "".join(f" | var {part}: | paper:" for part in ("x", "y", "cos θ", "sin θ"))
    return table(f"{head}in walls:{more}", rows)


def _paper_words() -> str:
    columns = ("{wall_share:.2p} %", "{wall_step_share:.2p} %", "{outlier_share:.1p} %")
    rows = [
        [
            f"`{found['method']}`",
            OFFSETS[int(found["offset"])],
            *(filled(c, found) for c in columns),
        ]
        for found in read("paper-200/paper")
        if int(found["offset"]) <= 0 and found["method"] != "dead-reckoning"
    ]
    return table("method | of | in walls: | came through walls: | more than 50 px off:", rows)


COSTS = {  # R, k
    "collisions only": (None, None),
    "20 px, 0.2 / px": (20.0, 0.2),
    "40 px, 0.2 / px": (40.0, 0.2),
    "40 px, 0.05 / px": (40.0, 0.05),
}


def _graded_map() -> str:
    places = [(r, s) for r in ("graded-map/rooms", "graded-map/wall") for s in ("guided", "paper")]
    error = "{error:.1f} [{error_low:.1f}, {error_high:.1f}]"
    found = {}
    for report in ("graded-map/rooms", "graded-map/wall"):
        for one in read(report):
            params = json.loads(one["params"])
            own = tuple(params.get(name) for name in ("inflation_radius", "cost_scaling_factor"))
            found[report, one["scenario"], one["method"], own, one["offset"]] = one
    rows = [
        [f"`{method}`", label, *(filled(error, found[r, s, method, own, "0"]) for r, s in places)]
        for method in ("mcl-map", "deq-mcl", "mcl-plan")
        for label, own in COSTS.items()
    ]
    head = "method | a step costs up to $R$, falls by $k$ | `guided`, in the middle: | `paper`:"
    return table(f"{head} | `guided`, along the wall: | `paper`:", rows)


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
    return table(f"{head} | inside 95 %: | NEES (3): | ms per step:", rows)


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
    "`deq-mcl-rejuvenated`", "`deq-mcl`", "`mcl-pilots`", "`mcl-map`", "`mcl`", "`grid`",
    OWN, "`ekf`", AMCL, "dead reckoning",
)  # fmt: skip
IN_PAPER = _methods(
    "dead reckoning", "`mcl-plan`", "`mcl-plan`, `keep` = 0", "`mcl-plan-hedged`",
    '`mcl-plan`, `charge` = "new"',
    "`deq-mcl-rejuvenated`", "`mcl-pilots`", "`mcl-map`", "`deq-mcl`", "`mcl`", OWN,
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
    return table(f"{head} | `mcl-plan-hedged`, difference: | of the error:", rows)


def _gaps() -> str:
    rows = []
    for label, method, params, limit, limit_params, offsets in (
        ("`mcl`", "mcl", {}, "mcl-smoother", {}, (0,)),
        ("`mcl-smoother`", "mcl-smoother", {}, "mcl-smoother", {}, (-20,)),
        ("`mcl-map`", "mcl-map", {}, "mcl-map-smoother", {}, (0,)),
        ("`mcl-map-smoother`", "mcl-map-smoother", {}, "mcl-map-smoother", {}, (-20,)),
        ("`mcl-pilots`", "mcl-pilots", {}, "mcl-pilots", {}, (0, -20)),
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
    return table(head, rows)


def _calibration() -> str:
    columns = [SHARE.replace("%s", f"coverage_{p}").replace("%%", "%") for p in (50, 80, 95)]
    columns.append("{nees:.1f} ({nees_low:.1f} to {nees_high:.1f})")
    rows = []
    for label, (method, params) in _methods(
        "`grid`", OWN, "`ekf`", "`mcl`", "`mcl-map`", "`deq-mcl`", "`deq-mcl-rejuvenated`",
        "`mcl-pilots`",
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
    return table(f"method | `matched`: {shares} | `guided`: {shares}", rows)


TABLES = {
    "plan-sensor, in short": _room,
    "paper": _table_1,
    "paper-200, paper": lambda: _paper_200("paper"),
    "paper-200, matched": lambda: _paper_200("matched"),
    "paper-200, sharp": lambda: _paper_200("sharp"),
    "paper-200, words": _paper_words,
    "graded-map": _graded_map,
    "plan-sensor, guided": lambda: _every_method("guided", IN_GUIDED),
    "plan-sensor, paper": lambda: _every_method("paper", IN_PAPER),
    "matched-sharp": _no_harm,
    "plan-sensor, gaps": _gaps,
    "calibration": _calibration,
}
