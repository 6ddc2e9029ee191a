"""``deqmcl speed``: our speed, as ratios to others measured in the same run.

``timing`` measures; ``rays``, ``steps``, ``trials`` and ``worlds`` say what is compared;
``scaling`` gives curves; ``tables`` and ``plots`` show it; ``command`` puts it together.
"""
