"""Makes its own generator from the entropy of the machine."""

import numpy as np

from localizers.template import MyLocalizer


class Broken(MyLocalizer):
    def reset(self, prior, plan, rng):
        return super().reset(prior, plan, np.random.default_rng())
