"""
A learned scan model
====================

Filters ask a scan model how likely a scan is at a pose. The usual beam model takes each beam for
itself: it meets the wall of the map, or reads anything. Where things stand about that are not on
the map, the beams that meet them are neighbours. A small net can learn that: here one that was
trained on other buildings (``docs/examples/learned_scan``), beside the beam model.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import deqmcl_gym
import localizers

folder = Path(deqmcl_gym.__file__).parents[1] / "docs/examples/learned_scan"  # in a clone
sys.path.insert(0, str(folder))
from learned_scan import ScanNet  # noqa: E402 - the plug-in
from training_data import recorded  # noqa: E402

net, beam = ScanNet(), localizers.CensoredGaussianUniform(sigma=0.5)

# %%
# The density of a beam whose range is 6 m on the map, by what the beams before it read. If
# they fitted, it is like the beam model; if two in a row were much too short, a box or a person may
# stand there, and shorter readings are likelier.

ranges = np.linspace(0.02, 11.98, 600)
expected = np.full((ranges.size, 16), 6.0)
figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
for words, before in (("those before it fitted", 6.0), ("the two before it read 2 m", 2.0)):
    scans = expected.copy()
    scans[:, 6:8] = before
    scans[:, 8] = ranges
    axes.plot(ranges, np.exp(net.log_density(scans, expected)[:, 8]), label=f"learned: {words}")
on_the_map = np.full((1, 1), 6.0, np.float32)
one_beam = [beam.log_likelihood(ranges[k : k + 1], on_the_map, 12.0)[0] for k in range(ranges.size)]
axes.plot(ranges, np.exp(one_beam), "k--", label="beam model: whatever they read")
axes.set(xlabel="range, m", ylabel="density, 1/m", title="a beam of 6 m on the map", yscale="log")
axes.set_ylim(1e-3, 10)
axes.legend(loc="upper left", fontsize="small")

# %%
# How likely scans are at the true poses, on average, in buildings that no training saw. On
# a right map the beam model is right and the net is not: it has to find out what the world is like.
# Where the map is wrong, the net predicts scans better. What that is worth to a filter is told in
# `Train a policy <../acting.html#a-learned-scan-model>`_.

levels = {"right map": "lost", "middle": folder / "middle.toml", "high": folder / "high.toml"}
scores = []
for level, scenario in levels.items():
    data = recorded((2000, 2100), 40, rooms=32, crop=2, scenario=str(scenario))
    seen, wall = (data[name].reshape(-1, 16).astype(np.float64) for name in ("scan", "expected"))
    usual = [
        beam.log_likelihood(z, e[None].astype(np.float32), 12.0)[0]
        for z, e in zip(seen, wall, strict=True)
    ]
    scores.append((np.mean(usual), net.log_density(seen, wall).sum(axis=1).mean()))
    print(f"{level}: beam model {scores[-1][0]:.2f}, learned {scores[-1][1]:.2f} nats a scan")

figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
places = np.arange(len(levels))
for shift, name, values in zip(
    (-0.2, 0.2), ("beam model", "learned"), np.transpose(scores), strict=True
):
    bars = axes.bar(places + shift, values, 0.38, label=name)
    axes.bar_label(bars, fmt="%.1f")
axes.set(ylabel="mean log-likelihood of a scan, nats", title="unseen buildings")
axes.set_xticks(places, levels)
axes.margins(y=0.1)
axes.legend(loc="lower left")
plt.show()
