"""``deqmcl speed``: our speed, as ratios to others measured in the same run.

``figure`` measures; ``rays``, ``steps`` and ``worlds`` say what is compared, on the ``work`` and
with the ``peers`` of their names; ``scaling`` gives curves; ``command`` puts it together.
"""
