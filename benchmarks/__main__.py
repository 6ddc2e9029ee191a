"""``python -m benchmarks`` is the ``deqmcl`` command."""

from benchmarks.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
