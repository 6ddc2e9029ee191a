"""The task: the reward of a step, and when the task is done; for single and vector envs."""

from deqmcl_gym.numerics.compiling import compiled

GOAL_BONUS = 100.0  # px of progress
COLLISION_PENALTY = 10.0  # px of progress


def once_round(length: float, radius: float) -> float:
    """Return the progress at which a robot, once round, touches the line that it started from.

    At least half the lap, however large the robot is.

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

    Progress beyond the goal does not count: the return of an episode is goal + bonus if it reaches
    the goal without contact, and less otherwise.

    Args:
        gained: progress of the step.
        progress: since reset, the step included.
        collided: whether a wall stopped the robot.
        goal: progress at which the task is done; inf if it never is.
        bonus: reward for being done.
        penalty: for a contact.
    """
    reward = gained - penalty * collided
    if progress < goal:
        return reward, False
    return reward - (progress - goal) + bonus, True
