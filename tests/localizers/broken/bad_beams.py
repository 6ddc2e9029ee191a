"""Trusts every beam."""

from localizers import PoseBelief, mean_pose
from localizers.template import MyLocalizer


class Broken(MyLocalizer):
    def update(self, ranges, action, plan):
        belief = super().update(ranges, action, plan)
        x, y, heading = mean_pose(*belief.points())
        return PoseBelief([x + 1e-9 * ranges.mean(), y, heading])
