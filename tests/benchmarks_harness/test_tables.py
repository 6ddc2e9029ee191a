"""trials.csv and timings.csv on made-up records."""

import pytest
from report_cases import finished, parsed

from benchmarks.tables.table_1 import timings_csv, trials_csv
from benchmarks.tables.text import csv_text


def test_trials_csv_has_a_line_per_trial_and_offset_with_its_counts():
    counted = finished("mcl", 4, 7.5, scores={"entropy": None}, params={"beta": "inf"})
    text = trials_csv(
        [
            counted | {"events": {"replanned_steps": 3}},
            finished("deq-mcl", 4, {0: 1.0, -20: 2.0}, filter_seed=1),
        ]
    )
    first, *rest = parsed(text)
    expected = {"method": "mcl", "params": '{"beta":"inf"}', "trial": "4", "filter_seed": "0"}
    expected |= {"scenario": "paper", "offset": "0", "error": "7.5", "lag": "20"}
    assert {name: first[name] for name in expected} == expected
    assert (first["entropy"], first["steps_done"], first["scans_used"]) == ("", "60", "60")
    assert (first["replanned_steps"], first["weight_collapses"]) == ("3", "")
    assert [(line["offset"], line["error"], line["filter_seed"]) for line in rest] == [
        ("0", "1.0", "1"),
        ("-20", "2.0", "1"),
    ]


def test_timings_csv_has_a_line_per_trial_in_seconds_and_milliseconds_per_step():
    timed, untimed = (finished("mcl", i, 1.0) | {"seconds": s} for i, s in enumerate((0.3, None)))
    lines = parsed(timings_csv([timed, untimed]))
    assert [(line["seconds"], line["ms_per_step"]) for line in lines] == [("0.3", "5.0"), ("", "")]


@pytest.mark.parametrize("unknown", [None, float("nan")])
def test_what_is_not_available_is_an_empty_cell_and_numbers_are_read_back_exactly(unknown):
    text = csv_text(["a", "b", "c"], [[unknown, 0.0, 0.1 + 0.2]])
    assert text == "a,b,c\n,0.0,0.30000000000000004\n"
