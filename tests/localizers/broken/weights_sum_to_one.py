"""Gives likelihoods for weights."""

from localizers.template import MyLocalizer


class Unnormalized:
    def __init__(self, belief):
        self.belief = belief

    def points(self, offset=0):
        points = self.belief.points(offset)
        return points and (points[0], 0.5 * points[1])


class Broken(MyLocalizer):
    def update(self, ranges, action, plan):
        return Unnormalized(super().update(ranges, action, plan))
