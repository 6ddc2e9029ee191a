"""Trusts every beam."""

from localizers import PoseBelief
from localizers.template import MyLocalizer


class Broken(MyLocalizer):
    def update(self, ranges, action, plan):
        belief = super().update(ranges, action, plan)
        x, y, heading = belief.points()[0][0]
        return PoseBelief([x + 1e-9 * ranges.mean(), y, heading])
