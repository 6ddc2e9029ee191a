"""The task: what a step earns, and when it is done. One rule, for one room and for many."""

from deqmcl_gym.numerics.compiling import compiled

GOAL_BONUS = 100.0  # px of progress
COLLISION_PENALTY = 10.0  # px of progress


def once_round(length: float, radius: float) -> float:
    """Return the progress at which a robot that went round touches the line it started from.

    Half the lap at least, for a robot that is large for its lap.

    Args:
        length: of the lap.
        radius: of the robot.
    """
    return length - min(length / 2, radius)


@compiled
def judged(
    gained: float, progress: float, collided: bool, goal: float, bonus: float, penalty: float
) -> tuple[float, bool]:
    """Return the reward of a step, and whether the task is done.

    Progress beyond the goal does not count, so whoever comes there without contact has earned
    goal + bonus, and whoever does not has earned less.

    Args:
        gained: progress of the step.
        progress: since reset, the step included.
        collided: whether a wall stopped the robot.
        goal: progress at which the task is done; inf if it never is.
        bonus: for that.
        penalty: for a contact.
    """
    reward = gained - penalty * collided
    if progress < goal:
        return reward, False
    return reward - (progress - goal) + bonus, True
