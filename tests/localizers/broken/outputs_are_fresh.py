"""Answers with the array that it keeps."""

from localizers.template import MyLocalizer


class Kept:
    def __init__(self, belief):
        self.held = belief.points()

    def points(self, offset=0):
        return self.held if offset == 0 else None


class Broken(MyLocalizer):
    def update(self, ranges, action, plan):
        return Kept(super().update(ranges, action, plan))
