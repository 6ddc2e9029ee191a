"""What all workers share: loaded, and its kernels compiled, once, before they are forked."""

import contextlib
import gc

from benchmarks.execution.processes import load_trials
from benchmarks.setup.overrides import Overrides
from benchmarks.trials import Trial, code_digest
from benchmarks.trials.stage import Stage
from deqmcl_gym.numerics.compiling import leave_untold

leave_untold()
load_trials()
_FEW = Overrides({"particles": 2})
_SMALL = Trial(scenario="paper", localizer="deq-mcl", params=_FEW, lag=1, seed=0, trial=0)
with contextlib.suppress(Exception):  # whatever it is, the trials will say so
    Stage.of(_SMALL).trace()
code_digest()
gc.freeze()  # no worker searches it for garbage
