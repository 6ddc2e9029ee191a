"""Other packages at the same work, written as their users would; imported where they are used.

A caster's ``caster(floor_plan, beams)`` returns what casts a fan of beams, from -π against the
heading on, at one pose. A filter's ``mcl(robot, particles, prior, rng)`` returns ``update`` of
MCL, which resamples systematically at every step; it is given our NumPy models
(``numpy_baseline``), so that what differs is the filter.
"""
