"""
Figures for a paper
===================

``deqmcl report results --latex --pdf`` writes a sweep's tables in LaTeX, its charts as PDF, and
BibTeX. This script does the same in Python, and draws another figure, one column wide.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

import benchmarks
from benchmarks.report.page import latex_files, pdf_files
from benchmarks.sweeps.store import write_files

sweep = benchmarks.sweep(
    "guided",
    title="Does a plan replace particles?",
    localizers=["mcl-map", "mcl-plan"],
    baseline="mcl-map",
    trials=8,
    vary={"params.particles": [50, 150, 500]},
)
folder = Path(tempfile.mkdtemp())
results = sweep.run(jobs=1, out=folder / "results", progress=False).results

# %%
# To read the results of an earlier sweep, use ``benchmarks.sweeps.results.results_in``. Eight
# worlds are few: the report says how many a paper needs.

files = write_files(folder / "export", latex_files(results) | pdf_files(results))
print(*(file.relative_to(folder) for file in files[:6]), sep="\n")
table = (folder / "export" / "tables.tex").read_text()
print(table[table.index(r"\begin{tabular}") : table.index(r"\end{table*}")])

# %%
# There is a panel for each setting; its rows have the columns of ``results.csv``, with 95 %
# intervals over worlds.

rows = pd.concat(
    panel.present.assign(particles=panel.swept["particles"]) for panel in results.panels
)
plt.rcParams.update({"font.size": 8, "pdf.fonttype": 42})  # 42: text stays text
figure, axes = plt.subplots(figsize=(3.4, 2.2), layout="constrained")
for method, own in rows.groupby("method"):
    axes.plot(own["particles"], own["error"], "o-", label=method)
    axes.fill_between(own["particles"], own["error_low"], own["error_high"], alpha=0.2)
particles = sorted(rows["particles"].unique())
axes.set(xlabel="particles", ylabel="error, px", xscale="log", ylim=(0, None))
axes.set_xticks(particles, labels=particles)
axes.minorticks_off()
axes.legend()
figure.savefig(folder / "column.pdf")
plt.show()
