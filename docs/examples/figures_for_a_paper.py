"""
Figures for a paper
===================

``deqmcl export results`` writes what a paper needs from a sweep: tables in LaTeX, its charts as
PDF, BibTeX. Here is the same in Python, and a figure of one's own as wide as a column.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

from benchmarks.execution.engines import Where
from benchmarks.files import write_part
from benchmarks.report.latex import latex_files, pdf_files
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.factors import Axis, Method
from benchmarks.sweeps.running import Options, begun

sweep = Sweep(
    title="Does a plan replace particles?",
    scenario="guided",
    localizers=(Method(name="mcl-map"), Method(name="mcl-plan")),
    baseline="mcl-map",
    trials=8,
    vary=(Axis(values={"params.particles": (50, 150, 500)}),),
)
folder = Path(tempfile.mkdtemp())
how = Options(where=Where(jobs=1), progress=False)
with begun(sweep, folder / "results", how, command=["this script"]) as running:
    results = running.results()

# %%
# ``results_in`` of ``benchmarks.sweeps.collecting`` reads results from a folder. Eight worlds are
# few: the report says how many a paper needs.

files = write_part(folder / "export", "export", latex_files(results) | pdf_files(results))
print(*(file.relative_to(folder) for file in files[:6]), sep="\n")
table = (folder / "export" / "tables.tex").read_text()
print(table[table.index(r"\begin{tabular}") : table.index(r"\end{table*}")])

# %%
# Every setting is a panel; its rows have estimates with 95 % intervals over worlds.

plt.rcParams.update({"font.size": 8, "pdf.fonttype": 42})  # 42: text stays text
figure, axes = plt.subplots(figsize=(3.4, 2.2), layout="constrained")
for method in ("mcl-map", "mcl-plan"):
    found = []
    for panel in results.panels:
        row = next(row for row in panel.present if row.method.localizer == method)
        found.append((dict(panel.swept)["particles"], *row.error))
    particles, mean, low, high = zip(*found, strict=True)
    axes.plot(particles, mean, "o-", label=method)
    axes.fill_between(particles, low, high, alpha=0.2)
axes.set(xlabel="particles", ylabel="error, px", xscale="log", ylim=(0, None))
axes.set_xticks(particles, labels=particles)
axes.minorticks_off()
axes.legend()
figure.savefig(folder / "column.pdf")
plt.show()
