"""The scenarios, one file each: what is in ``SCENARIO`` there goes by the name of the file.

Nothing of the paper's setting but room, L, β and the number of trials is published. ``paper`` was
chosen by the plain MCL row of its Table 1 alone: large assumed noise, a weak sensor, a local start.
"""
