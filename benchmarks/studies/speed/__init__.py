"""``deqmcl speed``: our speed, as ratios to others measured in the same run.

``figure`` measures; ``rays``, ``steps`` and ``worlds`` say what is compared, on the ``work`` and
with ``numpy_baseline`` and ``peers``; ``steps`` gives curves, too; ``command`` puts it together.
"""
