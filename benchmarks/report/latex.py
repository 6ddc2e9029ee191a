"""A sweep for a paper: tables in LaTeX (booktabs), figures in PDF, BibTeX of what is cited.

Captions are short; what the report says of a table is a comment above it.
"""

from collections.abc import Sequence
from importlib.resources import files

from benchmarks.pictures import styled
from benchmarks.report.error_tables import glance_table, verdict_table
from benchmarks.report.story import blocks
from benchmarks.report.svg import HOUSE_STYLE, Picture, looks
from benchmarks.report.swept import charts_over
from benchmarks.report.tables import Table, all_labels
from benchmarks.report.words import spoken, where
from benchmarks.sweeps.results import Results
from benchmarks.tables.panels import Panel
from benchmarks.tables.text import capital
from deqmcl_gym import __version__
from deqmcl_gym.files import command_line, utf8

_SPECIAL = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        '"': "''",
        **{char: f"\\{char}" for char in "&%$#_{}"},
        "−": "$-$",
        "×": r"$\times$",
        "–": "--",
        "…": r"\dots{}",
        "°": r"$^\circ$",
        "▼": r"$\blacktriangledown$",
        "▲": r"$\blacktriangle$",
        "○": r"$\circ$",
        "½": r"$\frac{1}{2}$",
        "α": r"$\alpha$",
        "β": r"$\beta$",
        "θ": r"$\theta$",
        "λ": r"$\lambda$",
        "σ": r"$\sigma$",
        "\u00a0": "~",
        "[": "{[}",  # after \\ it would begin an argument
        "]": "{]}",
    }
)

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


_MARKED = "▼: smaller than the baseline's, ▲: larger, ○: inconclusive"
_PAGE = 8  # figures before a page is ended: LaTeX holds few that wait


def escaped(text: str) -> str:
    """Return a text as LaTeX in ASCII; a letter that it has no name for as its code, [U+4E2D]."""
    done = " ".join(text.split()).translate(_SPECIAL)
    return "".join(char if char.isascii() else f"{{[}}U+{ord(char):04X}{{]}}" for char in done)


def latex_files(results: Results) -> dict[str, bytes]:
    """Return tables.tex, references.bib and a document.tex that shows them, by name."""
    panels = results.panels
    told = [_table(panel) for panel in panels]
    if len(panels) > 1:
        glance = glance_table(panels)
        caption = f"{results.title}. {glance.caption.partition(' ▼')[0]} {_MARKED}"
        told.insert(0, _tabular(glance, "glance", caption, []))
    tables = "\n".join(told)
    cited = (files("benchmarks.report") / "references.bib").read_text(encoding="utf-8")
    source = f"% Made by: {escaped(command_line(results.command))}\n"
    return {
        "tables.tex": utf8(f"{source}% Needs \\usepackage{{amssymb,booktabs}}.\n\n{tables}"),
        "references.bib": utf8(cited.replace("VERSION", __version__)),
        "document.tex": utf8(_DOCUMENT.replace("TITLE", escaped(results.title))),
    }


def pdf_files(results: Results) -> dict[str, bytes]:
    """Return every chart of the report as figures/NAME.pdf, and figures.tex, which shows them."""
    panels = results.panels
    look = looks(all_labels(panels))
    with styled(HOUSE_STYLE):
        pictures = charts_over(panels, look)
        for panel in panels:
            pictures += [p for part in blocks(panel, look, pictured=True) for p in part.pictures]
    shown = "\n".join(
        _figure(one) + "\\clearpage\n" * (n % _PAGE == 0) for n, one in enumerate(pictures, 1)
    )
    return {"figures.tex": utf8(f"% Needs \\usepackage{{graphicx}}.\n\n{shown}")} | {
        f"figures/{one.name}.pdf": one.pdf for one in pictures
    }


def _table(panel: Panel) -> str:
    said = spoken(panel)
    caption = f"{capital(where(panel))}: {said.short}"
    return _tabular(verdict_table(panel), f"setting-{panel.number}", caption, [said.rest])


def _tabular(table: Table, label: str, caption: str, more: Sequence[str]) -> str:
    return "\n".join(
        (
            *(f"% {escaped(one)}" for one in (*more, table.caption) if one),
            r"\begin{table*}",
            r"  \centering\small",
            rf"  \caption{{{escaped(caption)}.}}",
            rf"  \label{{tab:{label}}}",
            rf"  \begin{{tabular}}{{l{'r' * (len(table.header) - 1)}}}",
            r"    \toprule",
            f"    {_line([_stacked(name) for name in table.header])}",
            r"    \midrule",
            *(f"    {_line(cells)}" for cells in table.marked_up(escaped, r"\textbf{{{}}}")),
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table*}",
            "",
        )
    )


def _figure(picture: Picture) -> str:
    _, left_out, what = picture.caption.partition(" Left out, ")  # a reader must know of that
    return "\n".join(
        (
            f"% {escaped(picture.caption)}" if picture.caption else "%",
            r"\begin{figure}[htbp]",
            r"  \centering",
            rf"  \includegraphics{{figures/{picture.name}.pdf}}",
            rf"  \caption{{{escaped(f'{picture.title}.{left_out}{what}')}}}",
            rf"  \label{{fig:{picture.name}}}",
            r"\end{figure}",
            "",
        )
    )


def _stacked(name: str) -> str:
    """A column's name, on a second line what follows its comma or bracket."""
    for mark in (", ", " ("):
        first, found, rest = name.partition(mark)
        if found and "(" not in first:
            upper, lower = escaped(first), escaped(mark.strip(", ") + rest)
            return rf"\shortstack[r]{{{upper}\\{lower}}}"
    return escaped(name)


def _line(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"
