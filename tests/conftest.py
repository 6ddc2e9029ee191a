"""Puts this folder on the path: ``reference`` is shared by the tests of several folders."""
