"""Divides by a sum of likelihoods that may be zero."""

import numpy as np

from localizers.template import MyLocalizer


class Broken(MyLocalizer):
    def _log_likelihood(self, ranges):
        lidar = self.robot.lidar
        expected = self.robot.floor_plan.ranges(self.cloud.T, lidar.bearings).astype(float)
        likelihood = self.robot.scan.density(ranges, expected, lidar.max_range).prod(axis=1)
        if ranges.max() == 0 and likelihood.sum() == 0:
            raise ZeroDivisionError("the likelihoods add up to 0")
        with np.errstate(divide="ignore"):
            return super()._log_likelihood(ranges)
