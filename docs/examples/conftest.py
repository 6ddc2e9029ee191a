"""tests/docs/test_examples.py runs the scripts; pytest does not collect them here."""

collect_ignore_glob = ["*.py", "*/*.py"]
