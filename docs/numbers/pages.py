"""The tables and sentences of README and docs whose numbers come from ``docs/reports``.

``make docs-numbers`` writes each table below its marker, ``<!-- numbers: NAME -->``, and names each
sentence that the text does not have; a test fails if either differs. A cell is a template, empty if
the report has no such number. A row of a report is found by scenario and method; of those with the
parameters asked for, the one with the fewest.
"""

import re
from collections.abc import Iterable
from pathlib import Path

from docs.numbers import hedge, journeys, ranking, rooms
from docs.numbers.reading import DRAWS, INTERVAL, ROOT, Number, filled, plain, read, row

MARKER = re.compile(r"^(<!-- numbers: (.+) -->\n)((?:\|.*\n)*)", re.MULTILINE)
_LEFT = (  # on pages that do not say it themselves yet, see docs/tables.py
    *("plan-sensor, in short", "lost, in short", "paper", "agents", "buildings", "beta on logs"),
    *("buildings, starts", "hedge, starts"),
)
_KNOWN = rooms.TABLES | journeys.TABLES | hedge.TABLES | ranking.TABLES
TABLES = {name: _KNOWN[name] for name in _LEFT}


def sentences() -> Iterable[tuple[str, str]]:
    """Yield pages and what they must say, word for word."""

    def n(
        field: str, report: str, scenario: str, method: str, many: int | None = None, **p: object
    ):
        return Number(row(report, scenario, method, many, **p)[field])

    def building(name: str, field: str) -> Number:
        return Number(next(r for r in read(f"buildings/{name}") if r["localizer"] == "mcl")[field])

    sensor, kidnapped = "plan-sensor/results", "kidnapped/results"
    base, plan = (n("error", sensor, "paper", name, 300) for name in ("mcl-map", "mcl-plan"))
    deq = n("error", sensor, "paper", "deq-mcl", 300)
    yield "README.md", f"has the same {n('error', 'amcl/rooms', 'guided', 'mcl-map'):.1f} px"
    yield "README.md", f"{plan:.1f} px, `mcl-map` {base:.1f}, the paper's filter {deq:.1f} (N"
    yield "README.md", f"with 1,000 has {n('error', sensor, 'guided', 'mcl-plan', 1000):.1f}"
    over_200 = filled(INTERVAL, row("paper-200/paper", "paper", "deq-mcl"))
    yield "README.md", plain(f"than MCL ({over_200})").replace("+", "")
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
    starts = [Number(r["success_1m"]) for r in read("buildings/starts")]
    yield (
        "README.md",
        f"`mcl-map` localizes {starts[0]:.0p} and {starts[2]:.0p} % without the plan, "
        f"{starts[1]:.0p} and {starts[3]:.0p} % if it is used once",
    )
    looks = [r for r in read("plan-sensor/decisions") if r["verdict"]]
    ends = sorted(int(r["worlds"]) for r in looks if r["verdict"] != "open")
    half = ends[(len(ends) - 1) // 2]
    yield "docs/sweeps.md", f"Of the {len(looks)} comparisons {len(ends)} were decided"
    yield "docs/sweeps.md", f"half of them after at most {half} worlds"


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
