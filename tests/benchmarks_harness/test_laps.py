"""Which trials are run again for the animations."""

from report_cases import finished

from benchmarks.report.laps import laps
from benchmarks.tables.panels import panels

# without mcl the first method is the baseline: here a variant of the same localizer
FORMS = ("systematic", "stratified")


def shown(lap):
    """Resampler, world and filter seed of the trials of an animation, side by side."""
    return [(dict(t.params)["resampler"], t.trial, t.filter_seed) for t in lap.trials]


def form(resampler, world, error, filter_seed=0):
    return finished("mcl-h", world, error, params={"resampler": resampler}, filter_seed=filter_seed)


def chosen(records):
    (panel,) = panels(records)
    return laps(panel)


def test_variants_of_one_localizer_are_animated_each_by_its_own_first_trial():
    records = [
        form(one, world, 1.0 + i + world, seed)
        for seed in (0, 1)
        for i, one in enumerate(FORMS)
        for world in (0, 1)
    ]
    best, *_ = chosen(records)
    assert shown(best) == [("systematic", 0, 0), ("stratified", 0, 0)]
    assert "mcl-h resampler=systematic and mcl-h resampler=stratified" in best.caption


def test_a_baseline_without_a_trial_on_the_world_is_not_named():
    records = [form("systematic", 1, 1.0), form("stratified", 1, 3.0), form("stratified", 0, 2.0)]
    best, *_ = chosen(records)
    assert shown(best) == [("stratified", 0, 0)]
    assert best.caption.startswith("World 0, mcl-h resampler=stratified: error")
