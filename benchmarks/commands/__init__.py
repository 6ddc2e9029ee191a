"""The commands of ``deqmcl``, one file each: ``new-map`` is ``new_map.py``.

A file holds ``arguments(parser)`` and ``run(options) -> str``, what to print; ``options.words`` are
the words of the command line. Its docstring is what ``--help`` says. It imports what is heavy only
where it runs, so that ``deqmcl new-map --help`` stays fast.
"""

COMMANDS = {
    "paper": "run the paper's experiment: Table 1, figures, report",
    "sweep": "run a suite or a sweep file; resumable, on one or many machines",
    "report": "rewrite the report of a folder of results, or write one of several",
    "verify": "see whether today's code, libraries and plug-ins get the numbers in a folder",
    "export": "tables in LaTeX, figures in PDF and BibTeX from a folder of results",
    "list": "list suites, localizers, scenarios and agents",
    "run": "run one lap: animation, error curve, trace",
    "replay": "play a recorded log to localizers, and compare them",
    "tune": "search the parameters of a localizer on your logs",
    "score": "score what another stack has estimated, with the columns of replay",
    "from-nav2": "turn Nav2's AMCL parameters into a sweep file",
    "check": "check that a localizer obeys the laws the benchmarks rely on",
    "new-localizer": "write a small working localizer to start from",
    "new-map": "write a generated building as a ROS map and as polygons",
}
GONE = {  # said to whoever still types them
    "basin": "deqmcl sweep basin --set world.log=LOG --set world.map=MAP.yaml asks that",
    "phase": "in a clone, docs/examples/theta_phase.py draws the queue as theta phase",
    "speed": "in a clone, python -m benchmarks.studies.speed --out DIR measures it",
    "leaderboard": "deqmcl report A B C --out DIR makes one report of folders of the same worlds",
}
