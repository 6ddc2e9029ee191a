"""Keep an engine busy with trials, and take what comes back: the only place that knows both."""

import time
from collections import Counter, deque
from collections.abc import Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait

from benchmarks.execution.engines import Engine
from benchmarks.execution.processes import TimedOutError
from benchmarks.trials.attempt import Outcome, attempt
from benchmarks.trials.spec import Trial
from deqmcl_gym.validation import in_words

TRIES = 3  # of a trial whose worker dies

_InFlight = dict[Future[Outcome], tuple[str, Trial, float]]  # key, trial, when it was submitted


def outcomes(
    jobs: Iterable[tuple[str, Trial]], engine: Engine
) -> Generator[tuple[str, Outcome], None, None]:
    """Run (key, trial) pairs; yield (key, outcome) as they finish.

    No more than ``engine.slots`` are in flight, so that what is stopped or lost is little. A trial
    that its engine loses (its worker died) is tried again; one that hangs is not, and keeps its
    slot: what else is sent to that worker would wait behind it.

    Raises:
        RuntimeError: the engine itself broke, or hangs in all its slots.
    """
    waiting = deque(jobs)
    tries: Counter[str] = Counter()
    in_flight: _InFlight = {}
    hung: list[Future[Outcome]] = []
    while waiting or in_flight:
        if len(hung) == engine.slots:
            raise RuntimeError(
                f"all {len(hung)} workers hang; finished trials are kept, run the command again "
                "for the rest."
            )
        while waiting and len(in_flight) + len(hung) < engine.slots:
            key, trial = waiting.popleft()
            future = engine.executor.submit(attempt, trial, key)
            in_flight[future] = key, trial, time.monotonic()
            if future.done():
                break  # an engine that runs it here: take it at once
        for future in _landed(in_flight, engine):
            key, trial, _ = in_flight.pop(future)
            if not future.done():
                hung.append(future)
                yield key, Outcome(reason=f"no result within {engine.timeout:g} s")
                continue
            tries[key] += 1
            outcome = _outcome(future, tries[key])
            if outcome is None:
                waiting.appendleft((key, trial))
            else:
                yield key, outcome


def _landed(in_flight: _InFlight, engine: Engine) -> set[Future[Outcome]]:
    """Wait for futures that are done, or have been in flight for too long."""
    if engine.timeout is None:
        return wait(in_flight, return_when=FIRST_COMPLETED).done
    first = min(started for _, _, started in in_flight.values())
    patience = max(0.0, first + engine.timeout - time.monotonic())
    done = wait(in_flight, timeout=patience, return_when=FIRST_COMPLETED).done
    late = time.monotonic() - engine.timeout
    return done or {future for future, (_, _, started) in in_flight.items() if started <= late}


def _outcome(future: Future[Outcome], tries: int) -> Outcome | None:
    """Return what came of a trial; None to try again."""
    try:
        return future.result()
    except TimedOutError as error:
        return Outcome(reason=str(error))
    except BrokenExecutor as error:
        words = str(error) or in_words(error)
        raise RuntimeError(f"the executor broke ({words}); finished trials are kept.") from error
    except (Exception, SystemExit) as error:  # of the engine: a trial's own errors are outcomes
        if tries < TRIES:
            return None
        return Outcome(reason=f"lost {tries} times by its worker; last: {in_words(error)}")
