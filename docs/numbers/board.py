"""The tables of docs/leaderboard.md and of its agents in docs/acting.md, from its CSV files."""

from collections.abc import Callable, Mapping

from docs.numbers.reading import Cells, Number, filled, read, table

_HEAD = (
    "setting | method | public: | to the baseline: | held-out: | to the baseline: | gap: | cost: | "
    "label"
)
_SIGNS = {"public": "", "public_diff": "+", "held_out": "", "held_out_diff": "+", "gap": "+"}


def _board(report: str) -> Callable[[], str]:
    """Return what writes the rows of a leaderboard.csv; a setting is named in its first row."""

    def rows() -> str:
        lines: list[Cells] = []
        before = ""
        for row in read(report):
            lines.append([
                "" if row["setting"] == before else f"`{row['scenario']}`, {_what(row)}",
                f"`{row['method']}`",
                *(filled(_form(name, row["score"]), row) or "–" for name in _SIGNS),
                f"{Number(row['cost']):.2f} ×",
                row["label"],
            ])  # fmt: skip
            before = row["setting"]
        return table(_HEAD, lines)

    return rows


def _form(name: str, score: str) -> str:
    """Return the template of an estimate: errors have two digits, shares are in per cent."""
    form = ".2f" if score == "error" else ".0p"
    return f"{{{name}:{_SIGNS[name]}{form}}} ({{{name}_low:{form}}} to {{{name}_high:{form}}})"


def _what(row: Mapping[str, str]) -> str:
    return f"e in {row['unit']}" if row["score"] == "error" else "% localized"


def _agents() -> str:
    """Return a row per agent: its share, and how much above its baseline, with each localizer."""
    rows = {row["method"]: row for row in read("ranking/agents")}
    lines: list[Cells] = []
    for agent in dict.fromkeys(method.partition(" with ")[0] for method in rows):
        own = [rows[f"{agent} with {localizer}"] for localizer in ("mcl-map", "amcl")]
        shares = [[filled(_SHARE, row), filled(_ABOVE, row) or "–"] for row in own]
        lines.append([f"`{agent}`", *shares[0], *shares[1]])
    return table(
        "agent | localized with `mcl-map`: | above `still`, points: | with `amcl`: | "
        "above `still`, points:",
        lines,
    )


_SHARE = "{public:.0p} % ({public_low:.0p} to {public_high:.0p})"
_ABOVE = "{public_diff:.0p} ({public_diff_low:.0p} to {public_diff_high:.0p})"

TABLES = {
    "agents": _agents,
    "leaderboard": _board("ranking/leaderboard"),
    "leaderboard-agents": _board("ranking/agents"),
}
