"""The commands of ``deqmcl``, one file each.

A file holds ``arguments(parser)`` and ``run(options) -> str``, what to print; ``options.words`` are
the words of the command line. Its docstring is what ``--help`` says. It imports what is heavy only
where it runs, so that ``deqmcl new --help`` stays fast.
"""

GROUPS = {
    "for everybody": {
        "paper": "run the paper's experiment: Table 1, figures, report",
        "run": "run one lap: animation, error curve, trace",
        "sweep": "run a suite, a scenario or a sweep file; resumable, on one or many machines",
        "report": "rewrite the report of a folder of results, or write one of several",
        "check": "check that a localizer obeys the laws the benchmarks rely on",
        "list": "list suites, localizers, scenarios and agents; describe a localizer",
    },
    "for robots": {
        "replay": "play a recorded log to localizers, and compare them",
        "score": "score what another stack has estimated, with the columns of replay",
        "tune": "search the parameters of a localizer on your logs",
    },
    "for authors": {
        "new": "write a small working localizer, or a generated building, to start from",
        "verify": "see whether today's code, libraries and plug-ins get the numbers in a folder",
    },
}
COMMANDS = {name: words for group in GROUPS.values() for name, words in group.items()}
GONE = {  # said to whoever still types them
    "basin": "deqmcl sweep basin --set world.log=LOG --set world.map=MAP.yaml asks that",
    "export": "deqmcl report DIR --latex --pdf writes them into DIR/export",
    "from-nav2": "deqmcl replay LOG --map MAP.yaml --nav2 PARAMS.yaml runs it, with --dry-run it "
    "prints the sweep file",
    "leaderboard": "deqmcl report A B C --out DIR makes one report of folders of the same worlds",
    "new-localizer": "deqmcl new localizer FILE.py writes one",
    "new-map": "deqmcl new map --out DIR writes one",
    "phase": "in a clone, docs/examples/theta_phase.py draws the queue as theta phase",
    "speed": "in a clone, python -m benchmarks.studies.speed --out DIR measures it",
}
GONE_OPTIONS = {
    "--agent": "--set agent=NAME",
    "--agents": "--set vary.agent=[A,B]",
    "--changed-walls": "--set world.changed_walls.share=0.3",
    "--max-beams": "--set world.max_beams=60",
    "--motion": "--set assumed.motion.alpha1=0.1, and so on for each",
    "--param": "--set params.LOCALIZER.KEY=VALUE",
    "--radius": "--set world.radius=0.2",
    "--read": "--set world.reading.NAME=VALUE",
    "--scan": "--set assumed.scan.sigma=0.1, and so on for each",
    "--suites": "deqmcl list suites",
    "--unknown": "--set world.unknown=free",
}
