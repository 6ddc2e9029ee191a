"""Draw docs/figures/hedge-ends.svg: what plans gain and cost each method that uses them.

``python -m docs.numbers.ends`` reads docs/reports/hedge/ends.csv and writes the picture.
"""

import sys

from benchmarks.pictures import styled
from benchmarks.report.svg import HOUSE_STYLE, INK, LOOKS, Picture, canvas, picture
from deqmcl_gym.files import write_text
from docs.numbers.hedge import ENDS
from docs.numbers.reading import ROOT, row

FILE = ROOT / "docs" / "figures" / "hedge-ends.svg"
_SCENARIOS = {  # by column of the table: words, the look, and how far above the line
    "guided": ("the plan is right", "blue", 0.14),
    "guided-stale": ("the plan is for another start", "red", -0.14),
}


def ends_chart() -> Picture:
    """Return the differences from mcl-map at both ends, with their 95 % intervals."""
    colors = {look.name: look for look in LOOKS}
    words = [label for label, _, _ in _SCENARIOS.values()]
    with styled(HOUSE_STYLE):
        figure, axes = canvas(6.4, 3.4, left=1.75, legend_of=words)
        for scenario, (label, name, above) in _SCENARIOS.items():
            found = [row("hedge/ends", scenario, m, **params) for m, params in ENDS.values()]
            means, lows, highs = (
                [float(r[column]) for r in found] for column in ("diff", "diff_low", "diff_high")
            )
            ends = [
                [m - low for m, low in zip(means, lows, strict=True)],
                [high - m for m, high in zip(means, highs, strict=True)],
            ]
            places = [above - line for line in range(len(found))]
            look = colors[name]
            axes.errorbar(
                means, places, xerr=ends, fmt=look.mark, color=look.color, markersize=5, label=label
            )
        axes.axvline(0, color=INK, linewidth=0.8)
        axes.set_yticks([-line for line in range(len(ENDS))], [n.replace("`", "") for n in ENDS])
        axes.set_xlabel("error − that of mcl-map, px; left: gain, right: harm")
        return picture(
            figure,
            name="hedge-ends",
            title="Both ends: what plans gain and cost",
            caption="",
            alt="Difference in error from mcl-map of each method that uses plans, with the right "
            "plan and with that of another start. Only mcl-plan-hedged gains as much as mcl-plan "
            "and loses nothing.",
        )


def main() -> int:
    """Write the picture."""
    write_text(FILE, ends_chart().standalone)
    return 0


if __name__ == "__main__":
    sys.exit(main())
