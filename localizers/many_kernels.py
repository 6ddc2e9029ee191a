"""The compiled filters of many rooms, one room after the other; see ``localizers.many``."""

import numpy as np

from deqmcl_gym.maps.clusters import SECTORS
from deqmcl_gym.maps.drive_kernels import drive
from deqmcl_gym.numerics import Bools, Floats, Indices, Singles
from deqmcl_gym.numerics.compiling import compiled
from deqmcl_gym.numerics.elementary import atan2_64, cos64, sin64, wrapped64
from localizers.inference.particles import fill_systematic, normalize, shifted
from localizers.models.motion import noisy_moves
from localizers.models.range_table import Codes, add_from_table


@compiled
def filter_rooms(
    rooms: Indices,
    particles: Singles,
    log_weights: Floats,
    uniforms: Floats,
    commands: Floats,
    readings: Codes,
    bearings: Floats,
    noise: tuple[float, float, float],
    logs: Floats,
    tables: Codes,
    shapes: Indices,
    frames: Floats,
) -> None:
    """Do in each of ``rooms`` what ``ParticleFilter.step`` does with a ``RangeTable``."""
    n = particles.shape[2]
    weights, likelihood, total = np.empty(n), np.empty(n), np.empty(n)
    ancestors = np.empty(n, np.intp)
    kept, moves = np.empty((3, n), np.float32), np.empty((1, 3, n), np.float32)
    action = np.zeros((1, 3))
    for room in rooms:
        normalize(log_weights[room], weights)
        fill_systematic(weights, uniforms[room, 0], ancestors)
        for axis in range(3):
            for i in range(n):
                kept[axis, i] = particles[room, axis, ancestors[i]]
        action[0, 0], action[0, 2] = commands[room, 0], commands[room, 1]
        noisy_moves(uniforms[room : room + 1, 1:], action, noise[0], noise[1], noise[2], moves)
        drive(kept, moves[0], particles[room])
        log_weights[room] = 0.0
        rows, columns = shapes[room]
        shape = rows, columns
        frame = frames[room, 0], frames[room, 1], frames[room, 2]
        likelihood[:] = 0.0
        add_from_table(
            particles[room], readings[room], bearings, logs, tables[room], shape, frame, likelihood
        )
        if np.isfinite(shifted(log_weights[room], likelihood, total)):
            log_weights[room] = total


@compiled
def summarize_rooms(
    rooms: Indices,
    particles: Singles,
    log_weights: Floats,
    weights: Floats,
    size: float,
    means: Floats,
    covariances: Floats,
    best: Floats,
    second: Floats,
    shares: Floats,
) -> None:
    """Fill in weights (n, N), means, covariances and the two best clusters of ``rooms``.

    ``shares`` (n, 2) are those of the clusters, ``size`` the edge of their cells.
    """
    n = particles.shape[2]
    sine, cosine = np.empty(n), np.empty(n)
    for room in rooms:
        states, own, mean = particles[room], weights[room], means[room]
        normalize(log_weights[room], own)
        for i in range(n):
            heading = np.float64(states[2, i])
            sine[i], cosine[i] = sin64(heading), cos64(heading)
        x, y, s, c = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            x, y = x + own[i] * states[0, i], y + own[i] * states[1, i]
            s, c = s + own[i] * sine[i], c + own[i] * cosine[i]
        mean[0], mean[1], mean[2] = x, y, atan2_64(s, c)
        spread = np.zeros(6)
        for i in range(n):
            dx, dy = states[0, i] - x, states[1, i] - y
            turn, weight = wrapped64(states[2, i] - mean[2]), own[i]
            spread[0] += weight * dx * dx
            spread[1] += weight * dx * dy
            spread[2] += weight * dx * turn
            spread[3] += weight * dy * dy
            spread[4] += weight * dy * turn
            spread[5] += weight * turn * turn
        of = covariances[room]
        of[0, 0], of[1, 1], of[2, 2] = spread[0], spread[3], spread[5]
        of[0, 1] = of[1, 0] = spread[1]
        of[0, 2] = of[2, 0] = spread[2]
        of[1, 2] = of[2, 1] = spread[4]
        left = np.ones(n, np.bool_)
        shares[room, 0] = _cluster(states, own, sine, cosine, left, size, best[room])
        second[room] = best[room]
        shares[room, 1] = _cluster(states, own, sine, cosine, left, size, second[room])


@compiled
def _cluster(
    states: Singles,
    weights: Floats,
    sine: Floats,
    cosine: Floats,
    left: Bools,
    size: float,
    mean: Floats,
) -> float:
    """Fill in the best cluster of the points that are ``left``, and take it from them.

    Returns its share, 0 if none of them has weight. The rule is that of
    ``deqmcl_gym.maps.clusters.best_cluster``.
    """
    n = states.shape[1]
    columns, rows, sectors = np.empty(n, np.intp), np.empty(n, np.intp), np.empty(n, np.intp)
    least_column, least_row, most_column, most_row = 2**62, 2**62, -(2**62), -(2**62)
    total = 0.0
    for i in range(n):
        columns[i] = int(np.floor(np.float64(states[0, i]) / size))
        rows[i] = int(np.floor(np.float64(states[1, i]) / size))
        turned = (wrapped64(np.float64(states[2, i])) + np.pi) * (SECTORS / (2 * np.pi))
        sectors[i] = int(np.floor(turned)) % SECTORS
        if left[i]:
            total += weights[i]
            least_column, most_column = min(least_column, columns[i]), max(most_column, columns[i])
            least_row, most_row = min(least_row, rows[i]), max(most_row, rows[i])
    if not total > 0.0:
        return 0.0
    height = most_row - least_row + 1
    counts = np.zeros((most_column - least_column + 1) * height * SECTORS)
    for i in range(n):
        if left[i]:
            cell = (columns[i] - least_column) * height + rows[i] - least_row
            counts[cell * SECTORS + sectors[i]] += weights[i]
    heaviest = np.argmax(counts)
    sector, cell = heaviest % SECTORS, heaviest // SECTORS
    column, row = cell // height + least_column, cell % height + least_row
    x, y, s, c, share = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        apart = (sectors[i] - sector + 1) % SECTORS
        near = left[i] and abs(columns[i] - column) <= 1 and abs(rows[i] - row) <= 1 and apart <= 2
        if near:
            left[i] = False
            share += weights[i]
            x, y = x + weights[i] * states[0, i], y + weights[i] * states[1, i]
            s, c = s + weights[i] * sine[i], c + weights[i] * cosine[i]
    mean[0], mean[1], mean[2] = x / share, y / share, atan2_64(s, c)
    return share
