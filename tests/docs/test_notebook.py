"""The notebook's cells run from top to bottom, and what it says of their results is so."""

import json

import matplotlib.pyplot as plt
import numpy as np
import pytest
from test_links import ROOT

NOTEBOOK = ROOT / "docs" / "deq-mcl.ipynb"
FEWER = (('sweep("paper")', 'sweep("paper", trials=2)'), ("trials=10", "trials=2"))


@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive")
def test_the_notebook_runs_and_deq_mcl_loses_world_1(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    for many, few in FEWER:
        assert many in code
        code = code.replace(many, few)
    names = {"__name__": "__main__"}
    with plt.rc_context({"backend": "Agg"}):
        exec(compile(code, str(NOTEBOOK), "exec"), names)
    plt.close("all")
    errors = names["trials"].query("method == 'deq-mcl'").set_index("trial")["error"]
    assert errors[0] < 20.0
    assert errors[1] > 100.0
    assert names["distinct"](names["lost"][45]) < 100 < names["distinct"](names["plain"][45])
    rightwards = names["lost"][60].belief.points()[0][:, 0] > 250.0
    assert 0.4 < rightwards.mean() < 0.6  # about half goes the wrong way
    own = names["results"].trials.query("offset == 0").set_index(["method", "lag"])["error"]
    assert np.isfinite(own["ByHand"]).all()


def test_the_notebook_is_kept_without_outputs():
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    assert [cell for cell in cells if cell.get("outputs") or cell.get("execution_count")] == []
