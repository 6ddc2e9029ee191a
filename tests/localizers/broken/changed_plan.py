"""Insists that the robot does what was planned."""

import numpy as np

from localizers.template import MyLocalizer


class Broken(MyLocalizer):
    def reset(self, prior, plan, rng):
        self.plan = plan.copy()
        return super().reset(prior, plan, rng)

    def update(self, ranges, action, plan):
        if len(self.plan) and not np.array_equal(action, self.plan[0]):
            raise AssertionError("not as planned")
        self.plan = plan.copy()
        return super().update(ranges, action, plan)
