"""Deliberately wrong filters are caught by the same tests: the exactness tests can fail."""

from functools import cached_property

import numpy as np
import pytest
from ring_world import (
    FUTURE,
    PAST,
    Drive,
    RingMotion,
    RingScan,
    RingWalls,
    worst,
    z_scores,
)
from test_ring_redraw import DRIVES

from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.replanning import Redraw
from localizers.inference.resampling import Always

REPLICATES = 500  # fewer than where the right ones pass


class RechargesTheFuture(ParticleFilter):
    """Multiplies the g of the whole queued future into the weights at every step."""

    def step(self, belief, ranges, action, plan, rng):
        belief = super().step(belief, ranges, action, plan, rng)
        for s in range(belief.queue.ahead):
            before, after = belief.queue.at(s), belief.queue.at(s + 1)
            belief = belief.reweighted(self.feasibility.log_g(before, after))
        return belief


class ChargesOnTop(Redraw):
    """Multiplies the new future's g in and leaves the old one's where it is."""

    def _own_log_g(self, belief, shared):
        return np.zeros(belief.log_weights.size)


class DividesOnly(Redraw):
    """Divides by the old future's g and never charges the new one."""

    def _pilot(self, anchor, actions, pilots, rng):
        paths, log_g = super()._pilot(anchor, actions, pilots, rng)
        return paths, np.zeros_like(log_g)


class NeverNotices(Redraw):
    """Keeps the future that was drawn by the old plan."""

    def __call__(self, belief, actions, rng):
        return belief


class KeepsAnyPilot(Redraw):
    """Keeps the first pilot instead of one in proportion to its g."""

    def _pilot(self, anchor, actions, pilots, rng):
        paths, log_g = super()._pilot(anchor, actions, pilots, rng)
        return [np.repeat(states[:, :1], pilots, axis=1) for states in paths], log_g


def deq(filter_class: type[ParticleFilter] = ParticleFilter, pilots: int = 1) -> ParticleFilter:
    return filter_class(
        motion=RingMotion(),
        scan=RingScan(),
        feasibility=RingWalls(1.0),
        resampling=Always(),
        particles=8,
        past=PAST,
        future=FUTURE,
        pilots=pilots,
    )


def redrawing_by(redraw: type[Redraw]) -> type[ParticleFilter]:
    class Varied(ParticleFilter):
        @cached_property
        def _redraw(self):
            return redraw(self.motion, self.feasibility, self.pilots)

    return Varied


def test_recharging_the_future_at_every_step_is_caught():
    drive = Drive.as_planned(1, 1, 2, 1)
    assert worst(z_scores(deq(RechargesTheFuture), drive, 1.0, REPLICATES)) > 5


@pytest.mark.parametrize(
    ("redraw", "pilots", "drive"),
    [
        (ChargesOnTop, 1, "everything"),
        (DividesOnly, 1, "everything"),
        (NeverNotices, 1, "executed differs"),
        (KeepsAnyPilot, 16, "everything"),
    ],
)
def test_a_wrong_redraw_is_caught(redraw, pilots, drive):
    ring = deq(redrawing_by(redraw), pilots)
    assert worst(z_scores(ring, DRIVES[drive], 1.0, REPLICATES)) > 5
