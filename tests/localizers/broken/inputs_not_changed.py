"""Cuts the ranges off in place."""

import numpy as np

from localizers.template import MyLocalizer


class Broken(MyLocalizer):
    def update(self, ranges, action, plan):
        np.minimum(ranges, 100.0, out=ranges)
        return super().update(ranges, action, plan)
