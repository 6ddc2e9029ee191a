"""
A sweep and its report
======================

A sweep runs localizers on the same worlds and compares them world by world. This is a small one, so
its intervals are wide. `Sweeps <../sweeps.html>`_ lists all keys of a sweep file.
"""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

folder = Path(tempfile.mkdtemp())
(folder / "plan.toml").write_text("""
title = "Does the plan help?"
scenario = "guided"
localizers = ["mcl", "mcl-map", "mcl-plan"]
baseline = "mcl-map"
trials = 8
params.particles = 300
""")
command = [sys.executable, "-m", "benchmarks", "sweep", "plan.toml", "--out", "results"]
subprocess.run(command, cwd=folder, check=True)

# %%
# Read ``results/report.html``. ``trials.csv`` has a line per run and offset, for your own analysis.

with (folder / "results" / "trials.csv").open() as lines:
    rows = [row for row in csv.DictReader(lines) if row["offset"] == "0"]
errors = {}
for row in rows:
    errors.setdefault(row["method"], []).append(float(row["error"]))
for world in np.array(list(errors.values())).T:
    plt.plot(list(errors), world, "o-", color="tab:blue", alpha=0.5)
plt.gca().set(ylabel="error e of x[t]", title="a line per world")
plt.show()
