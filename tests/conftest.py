"""Puts this folder on the path: ``reference`` is shared by the tests of several folders.

Generated cases are the same in every run; ``--hypothesis-profile=many`` tries 500 new ones each.
"""

from hypothesis import settings

settings.register_profile("few", max_examples=25, derandomize=True, database=None)
settings.register_profile("many", max_examples=500, database=None)
settings.load_profile("few")
