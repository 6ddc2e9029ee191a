"""A sweep for a paper: tables in LaTeX (booktabs), charts in PDF, BibTeX of what is cited."""

from importlib.resources import files

from benchmarks.pictures import styled
from benchmarks.report.charts import STYLE
from benchmarks.report.frames import frames_of
from benchmarks.report.page import parts_of
from benchmarks.report.panel_charts import swept_charts
from benchmarks.report.tables import Table, glance_table, verdict_table
from benchmarks.report.verdict import verdict
from benchmarks.sweeps.results import Results
from deqmcl_gym import __version__
from deqmcl_gym.files import command_line, utf8

_SIGNS = str.maketrans(
    {
        "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
        "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': "''",
        **{char: f"\\{char}" for char in "&%$#_{}"},
        "−": "$-$", "×": r"$\times$", "–": "--", "…": r"\dots{}", "°": r"$^\circ$",
        "▼": r"$\blacktriangledown$", "▲": r"$\blacktriangle$", "○": r"$\circ$",
        "α": r"$\alpha$", "β": r"$\beta$", "θ": r"$\theta$", "λ": r"$\lambda$", "σ": r"$\sigma$",
        "\u00a0": "~", "½": r"$\frac{1}{2}$",
        "[": "{[}", "]": "{]}",  # after \\ it would begin an argument
    }
)  # fmt: skip


def escaped(text: str) -> str:
    """Return a text as LaTeX in ASCII; a letter that it has no name for as its code, [U+4E2D]."""
    done = " ".join(text.split()).translate(_SIGNS)
    return "".join(char if char.isascii() else f"{{[}}U+{ord(char):04X}{{]}}" for char in done)


def latex_files(results: Results) -> dict[str, bytes]:
    """Return tables.tex and references.bib by name."""
    panels = frames_of(results)
    parts = [
        f"% Made by: {escaped(command_line(results.command))}\n"
        "% Needs \\usepackage{amssymb,booktabs,graphicx}.\n"
    ]
    if len(panels) > 1:
        parts.append(_table(glance_table(panels), "glance", results.title))
    for panel in panels:
        told = f"{panel.where}: {verdict(panel).partition(':')[0]}"
        parts.append(_table(verdict_table(panel), f"setting-{panel.number}", told))
    cited = (files("benchmarks.report") / "references.bib").read_text(encoding="utf-8")
    return {
        "tables.tex": utf8("\n".join(parts)),
        "references.bib": utf8(cited.replace("VERSION", __version__)),
    }


def pdf_files(results: Results) -> dict[str, bytes]:
    """Return every chart of the report as figures/NAME.pdf."""
    panels = frames_of(results)
    with styled(STYLE):
        charts = swept_charts(panels)
        charts += [c for panel in panels for part in parts_of(panel) for c in part.charts]
        return {f"figures/{chart.name}.pdf": chart.drawn("pdf") for chart in charts}


def _table(table: Table, label: str, caption: str) -> str:
    return (
        f"% {escaped(table.caption)}\n\\begin{{table*}}\n\\centering\\small\n"
        f"\\caption{{{escaped(caption)}.}}\n\\label{{tab:{label}}}\n"
        f"\\resizebox{{\\linewidth}}{{!}}{{{table.latex(escaped).strip()}}}\n\\end{{table*}}\n"
    )
