"""Draw docs/figures/hedge-ends.svg: what plans gain and cost each method that uses them.

``python -m docs.numbers.ends`` reads docs/reports/hedge/ends.csv and writes the picture.
"""

import sys

from benchmarks.pictures import styled
from benchmarks.report.charts import INK, STYLE, Chart, canvas
from deqmcl_gym.files import write_text
from docs.numbers.hedge import ENDS
from docs.numbers.reading import ROOT, row

FILE = ROOT / "docs" / "figures" / "hedge-ends.svg"
_SCENARIOS = {  # by column of the table: words, colour and mark, how far above the line
    "guided": ("the plan is right", "C0", "o", 0.14),
    "guided-stale": ("the plan is for another start", "C3", "D", -0.14),
}


def ends_chart() -> Chart:
    """Return the differences from mcl-map at both ends, with their 95 % intervals."""
    with styled(STYLE):
        axes = canvas(6.4, 3.6)
        for scenario, (label, color, mark, above) in _SCENARIOS.items():
            found = [row("hedge/ends", scenario, m, **params) for m, params in ENDS.values()]
            means, lows, highs = (
                [float(r[column]) for r in found] for column in ("diff", "diff_low", "diff_high")
            )
            places = [above - line for line in range(len(found))]
            axes.hlines(places, lows, highs, color=color)
            axes.plot(means, places, mark, color=color, ms=5, label=label)
        axes.axvline(0, color=INK, lw=0.8)
        axes.set_yticks([-line for line in range(len(ENDS))], [n.replace("`", "") for n in ENDS])
        axes.set_xlabel("error − that of mcl-map, px; left: gain, right: harm")
        axes.figure.legend(loc="outside lower center", ncols=2, frameon=False)
        title = "Both ends: what plans gain and cost"
        return Chart("hedge-ends", title, "", axes.figure)


def main() -> int:
    """Write the picture."""
    write_text(FILE, ends_chart().drawn("svg").decode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
