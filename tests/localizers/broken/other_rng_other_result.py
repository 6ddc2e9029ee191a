"""Draws from rng, but what it uses has a seed of its own."""

import numpy as np

from localizers.template import MyLocalizer


class Broken(MyLocalizer):
    def reset(self, prior, plan, rng):
        rng.random()
        return super().reset(prior, plan, np.random.default_rng(0))
