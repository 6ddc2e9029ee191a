"""What people ask has a page and a heading that answers it."""

import json

import pytest
from test_links import ROOT, anchors

ANSWERS = {
    # somebody in a notebook
    "How do I install it without make?": "README.md#install-and-run",
    "What is worth a plan, in one table?": "README.md#what-a-plan-is-worth",
    "What does DEQ-MCL do in one step?": "docs/deq-mcl.ipynb#one-step-by-hand",
    "Why does it lose one world in ten?": "docs/deq-mcl.ipynb#why-it-loses-one-world-in-ten",
    "How do I get a LaTeX table?": "docs/deq-mcl.ipynb#your-own-localizer",
    "How do I compare a class of my own?": "docs/quickstart.md#plug-in-your-own",
    "What does a localizer get to know?": "docs/write-a-localizer.md#the-robot-model",
    "How do I find out that my localizer is right?": "docs/write-a-localizer.md#check-it",
    "How do I vary several things?": "docs/sweeps.md#a-sweep-file",
    "My folder is of older code, what now?": "docs/sweeps.md#after-a-change-of-code",
    "What becomes of an interrupted sweep?": "docs/sweeps.md#stop-resume-repeat",
    "Do numbers depend on my machine?": "docs/sweeps.md#seeds",
    "Which scenarios are there?": "docs/sweeps.md#scenarios",
    "How many worlds do I need?": "docs/reports.md#the-verdict",
    "How is an error computed?": "docs/reports.md#scores-of-a-trial",
    "What does this parameter do?": "docs/equations.md#parameters",
    "Where does the code differ from the paper?": "docs/equations.md#what-the-paper-leaves-open",
    "What is NEES, a world, a trial?": "docs/faq.md#terms",
    # somebody who trains policies
    "Which environments are there?": "docs/environment.md#ids",
    "What is in info?": "docs/environment.md#info",
    "How do I draw an L-shaped obstacle?": "docs/environment.md#your-own-room",
    "How do I scale observations?": "docs/environment.md#observations-and-actions-in--1-1",
    "What does a learner do with lost beams?": "docs/environment.md#lost-beams",
    "How do I record a video?": "docs/environment.md#pictures",
    "Is Journey-v1 hard?": "docs/acting.md#journey-v1",
    "What is a good score of Localize-v0?": "docs/acting.md#localize-v0",
    "How do I train in many buildings?": "docs/environment.md#offices",
    # somebody with a robot
    "What may my log look like?": "docs/your-map-your-log.md#what-your-files-may-look-like",
    "Can I give my nav2_params.yaml?": "docs/your-map-your-log.md#your-amcls-parameters",
    "The start is not known, what then?": "docs/your-map-your-log.md#where-the-robot-starts",
    "My lidar has a code for no return.": "docs/your-map-your-log.md#what-drivers-send",
    "Unknown cells are walls. Must they be?": "docs/environment.md#a-ros-map",
    "By which score do I tune?": "docs/tune-on-your-log.md#which-score",
    "How do I score slam_toolbox?": "docs/tune-on-your-log.md#score-your-own-stack",
    "How does it run on my robot?": "docs/write-a-localizer.md#on-your-robot",
    "Is amcl really Nav2's?": "docs/classical.md#amcl",
    "Does my robot's own plan help?": "docs/plan-sensor.md#whose-plan-is-it",
    "The robot is lost in a building.": "docs/plan-sensor.md#lost-kidnapped-driving",
    "Is it lost, or is the map wrong?": "docs/wrong-map.md#is-it-lost-or-is-the-map-wrong",
    # somebody who maintains it
    "Where is the reward?": "docs/architecture.md#where-to-change-what",
    "Why is this so?": "docs/decisions.md#the-world-paper-is-frozen",
}


@pytest.mark.parametrize("question", ANSWERS)
def test_a_question_has_its_answer(question):
    page, _, heading = ANSWERS[question].partition("#")
    text = (ROOT / page).read_text(encoding="utf-8")
    if page.endswith(".ipynb"):
        cells = json.loads(text)["cells"]
        text = "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    assert heading in anchors(text)
