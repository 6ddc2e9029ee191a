"""
Theta phase precession
======================

The queues of localizers as theta phase precession, like figures 1 and 3 of the paper. In the
hypothesis of its section 2, a theta cycle of the hippocampus holds one queue of states, read from
the past (early phase) to the future (late phase). [What it shows](../equations.md#theta-phase)

``theta_phase.py SCENARIO METHOD …`` draws another figure.
"""

import sys
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle, Polygon

import benchmarks
from benchmarks.setup.names import scenario

SCENARIO, *METHODS = sys.argv[1:] or ["paper", "mcl", "mcl-smoother", "deq-mcl", "deq-mcl-fresh"]
LAG, FIELDS = 20, 12
OFFSETS = np.arange(-LAG, LAG + 1)
PHASES = 360 * (OFFSETS + LAG + 0.5) / (2 * LAG + 1)  # of the offsets: equal parts, oldest first
NOT_HELD, FITTED = "#e4e4e4", "#d55e00"
# after Okabe & Ito (2008): told apart under every common colour blindness
HUES = np.array(
    [to_rgb(c) for c in ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#aa4499")]
)[np.arange(FIELDS) % 6]

# %%
# **Place fields** are discs at equal steps along the planned lap, as large as they can be without
# overlap.

room = scenario(SCENARIO).room().unwrapped
room.reset(seed=0)
path = room.course.path
begin = path.arc(room.course.start[:2])
centres = [path.at(begin + path.length * (i + 0.5) / FIELDS)[:2] for i in range(FIELDS)]
centres = np.array(centres)
apart = np.hypot(*(centres[:, None] - centres[None]).transpose(2, 0, 1))
radius = apart[apart > 0].min() / 2


def inside(places):
    """Whether each of n places is in each field, (n, FIELDS)."""
    return ((places[:, None, :2] - centres) ** 2).sum(axis=2) < radius**2


# %%
# **A cycle** is a step. At each offset k of a localizer's queue, the activity of a field is the
# mass of the belief about x[t+k] that is in it. The state at offset k has the phase
# 360° (k + L + ½) / (2L + 1), so the present is at 180°.


def summary(points):
    """Return the mass in each field (FIELDS,), the mean place (2,) and its spread."""
    poses, weights = points
    places = np.asarray(poses[:, :2], dtype=float)
    mean = weights @ places
    return weights @ inside(places), mean, np.sqrt(weights @ ((places - mean) ** 2).sum(axis=1))


def cycles(truth, queues):
    """Return what the queues of all steps say of states on the lap.

    Args:
        truth: poses, (T + 1, 3).
        queues: of each step, what is held by offset.

    Returns:
        The mass in each field, (T + 1, 2L + 1, FIELDS), NaN: not held; and the root mean square
        distance of the belief from the true place, (T + 1, 2L + 1).
    """
    activity = np.full((len(truth), OFFSETS.size, FIELDS), np.nan)
    distance = np.full((len(truth), OFFSETS.size), np.nan)
    for t, queue in enumerate(queues):
        for k, (active, mean, spread) in queue.items():
            if t + k < len(truth):
                activity[t, k + LAG] = active
                distance[t, k + LAG] = np.hypot(np.hypot(*(mean - truth[t + k, :2])), spread)
    return activity, distance


laps = {}
for method in METHODS:
    params = {} if method == "dead-reckoning" else {"particles": 1000}
    poses, queues = [], []
    for step in benchmarks.run(SCENARIO, method, **params):
        held = {k: step.belief.points(k) for k in range(-min(LAG, step.t), LAG + 1)}
        queues.append({k: summary(points) for k, points in held.items() if points is not None})
        poses.append(step.truth)
    truth = np.array(poses)  # the same for all methods
    laps[method] = cycles(truth, queues)
one = np.ones(1)
known = [
    {k: summary((truth[t + k][None], one)) for k in OFFSETS.tolist() if 0 <= t + k < len(truth)}
    for t in range(len(truth))
]
laps = {"perfect queue": cycles(truth, known), **laps}

# %%
# **Precession.** How far is the robot at t past each field's centre, counted from the visit that is
# nearest to x[t+k]? This position is regressed on the phase, over all steps, offsets and fields,
# weighted by the mass; the slope is the inverse. This way round nothing is cut off: at each phase
# the whole pass through a field is seen.

arcs = [path.arc(pose[:2]) for pose in truth.tolist()]
progress = np.cumsum([0.0, *(path.advance(a, b) for a, b in pairwise(arcs))])
past_centre = np.array([[path.advance(path.arc(c), arc) for c in centres.tolist()] for arc in arcs])
states = (np.arange(len(truth))[:, None] + OFFSETS).clip(0, len(truth) - 1)
passed = past_centre[states] - (progress[states] - progress[:, None])[:, :, None]
here = inside(truth)[states]


def precession(activity):
    """Return slope, correlation, and where the line is at 180°: NaN without a slope."""
    share = np.nan_to_num(activity)
    share /= share.sum()
    phase, place = (share.sum(axis=(0, 2)) * PHASES).sum(), (share * passed).sum()
    off_phase, off_place = PHASES - phase, passed - place
    of_phase = (share.sum(axis=(0, 2)) * off_phase**2).sum()
    covariance = ((share * off_place).sum(axis=(0, 2)) * off_phase).sum()
    if of_phase < 1:  # of one phase
        return np.nan, np.nan, place
    slope = of_phase / covariance
    correlation = covariance / np.sqrt(of_phase * (share * off_place**2).sum())
    return slope, correlation, place + (180 - phase) / slope


print("| method | phases | slope °/px | r | late by px | right field: past | present | future |")
for name, (activity, _) in laps.items():
    slope, correlation, late = precession(activity)
    active = PHASES[np.nan_to_num(activity).any(axis=(0, 2))]
    right = np.where(here.any(axis=2), (activity * here).sum(axis=2), np.nan)
    parts = [right[:, np.sign(OFFSETS) == sign] for sign in (-1, 0, 1)]
    means = [f"{np.mean(p[~np.isnan(p)]):.2f}" if (~np.isnan(p)).any() else "n/a" for p in parts]
    numbers = f"{slope:.2f} | {correlation:.2f} | {late:+.1f}".replace("nan", "n/a")
    ends = f"{active[0]:.0f}° to {active[-1]:.0f}°"
    print(f"| {name} | {ends} | {numbers} | {' | '.join(means)} |")

# %%
# **Left**: the cycles of a lap side by side; the hue is the field, its strength the mass. Gray: not
# held. **Middle**: all fields laid over each other, mean mass over the robot's position in the
# field and the phase, with the fitted line. **Right**: the table of the queue; a row is the queue
# at t, a column the state x[s], the colour how far the belief is from the true place. Down a column
# a state is predicted, filtered (on the dashed line), then smoothed.

extent = np.abs(passed[np.nan_to_num(laps["perfect queue"][0]) > 0]).max()
farthest = np.nanquantile(np.concatenate([laps[name][1].ravel() for name in METHODS]), 0.98)
times = np.arange(len(truth) // 2 - LAG, len(truth) // 2 + LAG + 1)
look = {"aspect": "auto", "interpolation": "nearest"}
figure, rows = plt.subplots(
    len(laps), 3, figsize=(11, 2.3 * len(laps)), layout="constrained", width_ratios=(2.1, 1, 1.15)
)
for (left, middle, right), (name, (activity, distance)) in zip(rows, laps.items(), strict=True):
    mass = np.nan_to_num(activity)
    picture = 1 - mass.sum(axis=2, keepdims=True).clip(0, 1) + mass @ HUES
    picture[np.isnan(distance)] = to_rgb(NOT_HELD)
    span = (-0.5, len(truth) - 0.5, 0, 360)
    left.imshow(picture.clip(0, 1).transpose(1, 0, 2), extent=span, origin="lower", **look)
    left.set_title(name, loc="left", fontweight="bold")
    left.set(ylabel="theta phase (°)", yticks=[0, 90, 180, 270, 360])

    held = ~np.isnan(activity) & (passed < extent)
    row = np.broadcast_to(PHASES[:, None], held.shape)[held]
    bins = {"bins": (OFFSETS.size, 41), "range": ((0, 360), (-extent, extent))}
    counts = np.histogram2d(row, passed[held], **bins)[0]
    sums = np.histogram2d(row, passed[held], weights=activity[held], **bins)[0]
    mean = np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0)
    span = (-extent, extent, 0, 360)
    middle.set_facecolor(NOT_HELD)
    masses = middle.imshow(mean, extent=span, origin="lower", cmap="Blues", vmin=0, vmax=1, **look)
    slope, _, late = precession(activity)
    active = PHASES[mass.any(axis=(0, 2))]
    middle.plot(late + (active - 180) / slope, active, color=FITTED)
    middle.set_title(f"slope {slope:.2f} °/px" if np.isfinite(slope) else "no slope", loc="left")
    middle.set_xlim(-extent, extent)
    middle.set_yticks([90, 180, 270], ["past", "now", "future"], rotation=90, va="center")

    if name == "perfect queue":
        continue
    shown = np.arange(times[0] - LAG, times[-1] + LAG + 1)
    offsets = shown - times[:, None]
    table = np.where(
        np.abs(offsets) <= LAG, distance[times[:, None], (offsets + LAG).clip(0, 2 * LAG)], np.nan
    )
    span = (shown[0] - 0.5, shown[-1] + 0.5, times[-1] + 0.5, times[0] - 0.5)
    right.set_facecolor(NOT_HELD)
    off = right.imshow(table, extent=span, cmap="viridis_r", vmin=0, vmax=farthest, **look)
    right.plot(times, times, "k--", linewidth=1)
    right.set_ylabel("scans up to t")
rows[-1][0].set_xlabel("theta cycle = step t")
rows[-1][1].set_xlabel("robot past the field's centre (px)")
rows[-1][2].set_xlabel("step s of the state")
figure.colorbar(masses, ax=rows[:, 1], location="bottom", label="mean mass in the field")
figure.colorbar(off, ax=rows[:, 2], location="bottom", label="RMS distance from the truth (px)")

plan = rows[0][2]
plan.add_patch(Polygon(room.floor_plan.outer, facecolor="white", edgecolor="black"))
for corners in room.floor_plan.obstacles:
    plan.add_patch(Polygon(corners, facecolor="#bbbbbb", edgecolor="black"))
for number, (place, hue) in enumerate(zip(centres, HUES, strict=True), start=1):
    plan.add_patch(Circle(place, radius, facecolor=hue))
    plan.text(*place, str(number), color="white", ha="center", va="center", fontsize=7)
plan.set_title(f"The place fields, radius {radius:.0f} px", loc="left")
plan.axis("equal")
plan.axis("off")
plt.show()
