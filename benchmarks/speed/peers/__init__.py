"""Other packages at the same work, written as their users would; imported where they are used.

Localizers are given our NumPy models (``numpy_baseline``), so that what differs is the filter.
"""
