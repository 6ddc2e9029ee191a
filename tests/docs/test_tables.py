"""The tables of the documents are those of the reports: ``python -m docs.tables``."""

from docs import tables


def test_every_table_of_the_pages_is_that_of_its_report():
    assert tables.main(["--check"]) == 0


def test_parts_of_a_files_name_are_columns():
    files = ["buildings/intel.csv", "buildings/freiburg-079-amcl.csv"]
    told = {"file": r"(?P<building>intel|freiburg)[-0-9]*(?P<model>\w+)?"}
    frame = tables.rows_of(files, "localizer in ('mcl', 'amcl')", **told)
    assert frame[["localizer", "building", "model"]].to_numpy().tolist() == [
        ["mcl", "intel", ""],
        ["amcl", "freiburg", "amcl"],
    ]
