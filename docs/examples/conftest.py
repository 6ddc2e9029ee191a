"""Scripts are run by tests/docs/test_examples.py; importing them needs the extra ``rl``."""

collect_ignore_glob = ["*.py", "*/*.py"]
