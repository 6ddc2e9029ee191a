"""Forgets to return the belief."""

from localizers.template import MyLocalizer


class Broken(MyLocalizer):
    def update(self, ranges, action, plan):
        super().update(ranges, action, plan)
