"""The tables of robots in buildings: lost, kidnapped, driving, real logs."""

import math

from docs.numbers.reading import (
    AMCL,
    ARRIVED,
    DIFF_METRES,
    DRAWS,
    METRES,
    OWN,
    RECOVERED,
    ROBOT,
    SUCCESS,
    Cells,
    filled,
    in_bold,
    read,
    row,
    table,
)


def _lost_in_short() -> str:
    columns = [SUCCESS, METRES, "{ms_per_step:.1f}"]
    rows = [
        [label, *(filled(c, row("lost/results", "lost", method, n, **params)) for c in columns)]
        for label, method, n, params in (
            (
                "`mcl-map` with random poses when scans fit badly, without the route",
                "mcl-map", 10_000, {},
            ),
            ("the same, N = 50,000", "mcl-map", 50_000, {}),
            (
                "`mcl-map`, the route used once, at the start: 20 poses drawn for each particle",
                "mcl-map", 10_000, DRAWS,
            ),
            ("`mcl-plan`: the route as evidence at every step", "mcl-plan", 10_000, {}),
        )
    ]  # fmt: skip
    rows[2] = in_bold(rows[2], 1, 2)
    for label, params in (
        ("`amcl` with the models of all others, at most 20,000 particles, with recovery", ROBOT),
        ("`amcl`, Nav2's, the same", {}),
    ):
        found = row("amcl/lost", "lost", "amcl", **params)
        cost = filled("{cost:.1f} × the first", found)
        rows.append([label, *(filled(c, found) for c in columns[:2]), cost])
    head = "method, N = 10,000 | localized to the end (1 m, 30°):"
    return table(f"{head} | metres driven until then, median: | ms per step:", rows)


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
            rows.append(in_bold(cells, 2) if params else cells)
    for label, params in ((OWN, ROBOT), (AMCL, {})):
        found = row("amcl/lost", "lost", "amcl", **params)
        cost = filled("{cost:.2f} ×", found)
        rows.append([label, "≤ 20,000", *(filled(c, found) for c in columns), cost])
    head = "method | N: | localized to the end (1 m, 30°): | metres until then, median:"
    more = "difference in metres (restricted mean): | false commitment: | ms per step:"
    return table(f"{head} | {more}", rows)


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
            rows.append(in_bold(cells, *confirmed.get((scenario, k), ())))
    head = "scenario | method | localized to the end (1 m, 30°): | metres until then, median:"
    return table(f"{head} | difference in metres: | false commitment:", rows)


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
                rows.append(in_bold(cells, *confirmed.get((scenario, n, k), ())))
        for label, params in ((OWN, ROBOT), (AMCL, {})) if scenario == "kidnapped" else ():
            found = row("amcl/lost", scenario, "amcl", **params)
            rows.append(["", label, "≤ 20,000", *(filled(c, found) for c in columns)])
    head = "scenario | method | N: | recovered: | metres until then, median:"
    return table(f"{head} | difference in metres:", rows)


def _driving() -> str:
    def cells(first: str, label: str, n: str, found: dict[str, str], *bold: int) -> Cells:
        contacts = "{contacts:.1f}" if float(found["contacts"]) < 20 else "{contacts:.0f}"
        columns = (ARRIVED, "{spl:.2f}", contacts)
        return in_bold([first, label, n, *(filled(c, found) for c in columns)], *bold)

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
    return table("scenario | method | N: | arrived without contact: | SPL: | contacts:", rows)


def _two_buildings() -> str:
    rows = []
    for building, length in (("freiburg-079", 392), ("intel", 504)):
        for k, (label, file, method) in enumerate((
            ("`mcl`", building, "mcl"),
            ("`mcl-map`", building, "mcl-map"),
            ("`mcl-plan`", building, "mcl-plan"),
            ("`mcl-plan-hedged`", building, "mcl-plan-hedged"),
            ("`amcl`, each 0.0625 m, 3°", f"{building}-amcl", "amcl"),
            ("… `likelihood_field_prob`", f"{building}-likelihood-field-prob", "amcl"),
        )):  # fmt: skip
            (found,) = (r for r in read(f"buildings/{file}") if r["localizer"] == method)
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
    return table(f"{head} | {more}", rows)


def _touching() -> str:
    rows, place = [], ""
    for found in read("beta-on-logs/results"):
        last, place = place, f"{found['building']}, {found['radius']} m"
        new, beta = place != last, found["beta"]
        columns = ("{position_median:.3f} m", "{position_p95:.3f} m", "{position_max:.2f} m")
        rows.append([
            place if new else "",
            filled("{touching:,.0f} of {poses:,.0f}", found) if new else "",
            f"`{found['localizer']}`" + (f", β = {beta}" if beta else ""),
            f"{found['lost']} of {found['runs']}",
            *(filled(column, found) for column in columns),
            filled("{coverage_95:.0p} %", found),
        ])  # fmt: skip
    head = "building, radius | reference poses that touch a wall: | localizer | lost:"
    return table(f"{head} | position, median: | 95 %: | largest: | inside 95 %:", rows)


def _starts() -> str:
    rows = []
    for k, found in enumerate(read("buildings/starts")):
        first, label = found["building"], "`mcl-map`, without the plan"
        if k % 2:
            first, label = "", "… with `start_draws`"
        cells = [first, label, *(filled(c, found) for c in (SUCCESS, METRES, DIFF_METRES))]
        cells[4] = cells[4] or "baseline"
        rows.append(in_bold(cells, *{1: (2, 4), 3: (4,)}.get(k, ())))
    head = "building | localizer | localized to the end (1 m, 30°): | metres to localize, median:"
    return table(f"{head} | difference in metres (restricted mean):", rows)


TABLES = {
    "lost, in short": _lost_in_short,
    "lost": _lost,
    "lost-hard": _lost_hard,
    "kidnapped": _kidnapped,
    "driving": _driving,
    "buildings": _two_buildings,
    "buildings, starts": _starts,
    "beta on logs": _touching,
}
