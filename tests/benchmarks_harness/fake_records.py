"""Records of trials made by hand, with only what a test is about."""

import csv
import io

from benchmarks.trials.scoring import SCORE_NAMES


def record(method, trial, errors, *, filter_seed=0, **scores):
    """A trial with ``errors`` by offset; every other score is 1 unless given."""
    return {
        "trial": {"localizer": method, "trial": trial, "filter_seed": filter_seed},
        "scores": [
            {"offset": offset, **dict.fromkeys(SCORE_NAMES, 1.0), "error": error, **scores}
            for offset, error in errors.items()
        ],
        "quality": None,
        "steps_done": 200,
        "scans_used": 199,
        "events": {},
        "seconds": 0.5,
    }


def parsed(text):
    """Lines of a CSV, each by column."""
    return list(csv.DictReader(io.StringIO(text)))
