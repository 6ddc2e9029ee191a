"""The tables of localizers and of agents on the worlds of one suite, from their CSV files."""

from collections.abc import Mapping

from docs.numbers.reading import Cells, Number, filled, read, table


def _localizers() -> str:
    """Return a row per setting and method, the best first; a setting is named in its first row."""
    lines: list[Cells] = []
    before = ""
    for row in read("ranking/localizers"):
        lines.append([
            "" if row["setting"] == before else f"`{row['scenario']}`, {_what(row)}",
            f"`{row['method']}`",
            *(filled(_form(name, row["score"], sign), row) or "–" for name, sign in _ESTIMATES),
            f"{Number(row['cost']):.2f} ×",
        ])  # fmt: skip
        before = row["setting"]
    return table("setting | method | value: | to the baseline: | cost:", lines)


_ESTIMATES = ("public", ""), ("public_diff", "+")


def _form(name: str, score: str, sign: str) -> str:
    """Return the template of an estimate: errors have two digits, shares are in per cent."""
    form = ".2f" if score == "error" else ".0p"
    return f"{{{name}:{sign}{form}}} ({{{name}_low:{form}}} to {{{name}_high:{form}}})"


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

TABLES = {"agents": _agents, "ranking": _localizers}
