"""Looks a heading up in a table from -π to π."""

import math

from localizers.template import MyLocalizer

SECTORS = ("west", "south", "east", "north")


class Broken(MyLocalizer):
    def reset(self, prior, plan, rng):
        heading = prior.mean[2] if prior.mean else 0.0
        self.sector = SECTORS[int((heading + math.pi) // (math.pi / 2))]
        return super().reset(prior, plan, rng)
