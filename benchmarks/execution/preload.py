"""What all workers share: loaded, and its kernels compiled, once, before they are forked."""

import contextlib
import gc

from benchmarks.execution.processes import load
from benchmarks.trials.attempt import trial_trace
from benchmarks.trials.provenance import code_digest
from benchmarks.trials.spec import Trial

load()
_SMALL = Trial(
    scenario="paper", localizer="deq-mcl", params=(("particles", 2),), lag=1, seed=0, trial=0
)
with contextlib.suppress(Exception):  # whatever it is, the trials will say so
    trial_trace(_SMALL)
code_digest()
gc.freeze()  # no worker searches it for garbage
