"""Starts from the prior's mean, whether it has one or not."""

from localizers.template import MyLocalizer


class Broken(MyLocalizer):
    def reset(self, prior, plan, rng):
        self.x, self.y, self.heading = prior.mean
        return super().reset(prior, plan, rng)
