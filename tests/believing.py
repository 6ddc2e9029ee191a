"""Localizers that believe what a test tells them."""

from localizers import Belief


class Believes:
    """Answers with one belief after the other, then with the last, whatever it is shown."""

    def __init__(self, *beliefs: Belief) -> None:
        self.beliefs, self.at = beliefs, 0

    def reset(self, prior, plan, rng):
        self.at = 0
        return self.beliefs[0]

    def update(self, ranges, action, plan):
        self.at = min(self.at + 1, len(self.beliefs) - 1)
        return self.beliefs[self.at]
