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
_DOCUMENT = r"""\documentclass{article}
\usepackage[margin=10mm,landscape]{geometry}
\usepackage{amssymb,booktabs,graphicx}
\title{TITLE}
\author{}
\begin{document}
\maketitle
Experiments by deqmcl-gym~\cite{deqmcl-gym}; DEQ-MCL is by
Taniguchi et al.~\cite{taniguchi2024deqmcl}.
\input{tables}
\IfFileExists{figures.tex}{\input{figures}}{}
\bibliographystyle{plain}
\bibliography{references}
\end{document}
"""
_PAGE = 8  # figures before a page is ended: LaTeX holds few that wait


def escaped(text: str) -> str:
    """Return a text as LaTeX in ASCII; a letter that it has no name for as its code, [U+4E2D]."""
    done = " ".join(text.split()).translate(_SIGNS)
    return "".join(char if char.isascii() else f"{{[}}U+{ord(char):04X}{{]}}" for char in done)


def latex_files(results: Results) -> dict[str, bytes]:
    """Return tables.tex, references.bib and a document.tex that shows them, by name."""
    panels = frames_of(results)
    source = f"% Made by: {escaped(command_line(results.command))}\n% Needs \\usepackage"
    parts = [f"{source}{{amssymb,booktabs,graphicx}}.\n"]
    if len(panels) > 1:
        parts.append(_table(glance_table(panels), "glance", results.title))
    parts += [
        _table(verdict_table(panel), f"setting-{panel.number}", f"{panel.where}: {head}")
        for panel in panels
        for head in [verdict(panel).partition(":")[0]]
    ]
    cited = (files("benchmarks.report") / "references.bib").read_text(encoding="utf-8")
    return {
        "tables.tex": utf8("\n".join(parts)),
        "references.bib": utf8(cited.replace("VERSION", __version__)),
        "document.tex": utf8(_DOCUMENT.replace("TITLE", escaped(results.title))),
    }


def pdf_files(results: Results) -> dict[str, bytes]:
    """Return every chart of the report as figures/NAME.pdf, and figures.tex, which shows them."""
    panels = frames_of(results)
    with styled(STYLE):
        charts = swept_charts(panels)
        charts += [c for panel in panels for part in parts_of(panel) for c in part.charts]
        drawn = {f"figures/{chart.name}.pdf": chart.drawn("pdf") for chart in charts}
    shown = [
        f"\\begin{{figure}}[htbp]\n  \\centering\n  \\includegraphics{{figures/{one.name}.pdf}}\n"
        f"  \\caption{{{escaped(f'{one.title}. {one.caption}')}}}\n  \\label{{fig:{one.name}}}\n"
        "\\end{figure}\n" + "\\clearpage\n" * (n % _PAGE == 0)
        for n, one in enumerate(charts, 1)
    ]
    return {"figures.tex": utf8("% Needs \\usepackage{graphicx}.\n\n" + "\n".join(shown))} | drawn


def _table(table: Table, label: str, caption: str) -> str:
    return (
        f"% {escaped(table.caption)}\n\\begin{{table*}}\n\\centering\\small\n"
        f"\\caption{{{escaped(caption)}.}}\n\\label{{tab:{label}}}\n"
        f"\\resizebox{{\\linewidth}}{{!}}{{{table.latex(escaped).strip()}}}\n\\end{{table*}}\n"
    )
