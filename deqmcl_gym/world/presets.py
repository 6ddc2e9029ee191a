"""The named worlds. What filters assume about them is part of a benchmark's scenario.

The paper publishes only the room; see docs/equations.md for the other choices.
"""

import math
from types import MappingProxyType

from deqmcl_gym.maps import Lidar
from deqmcl_gym.world.config import Driver, MotionNoise, Start, World
from deqmcl_gym.world.paper_room import PAPER_ROOM

WORLDS = MappingProxyType(
    {
        # one noisy beam ahead, little motion noise, exact start
        "paper": World(floor_plan=PAPER_ROOM),
        # the same, but the start is drawn from the filter's prior
        "matched": World(floor_plan=PAPER_ROOM, start=Start(sd_position=10.0, sd_heading=0.1)),
        # a sharp fan of nine beams
        "sharp": World(
            floor_plan=PAPER_ROOM, lidar=Lidar(beams=9, field_of_view=math.pi / 2, sigma=5.0)
        ),
        # strong motion noise, and a driver that corrects for it from the true pose
        "guided": World(
            floor_plan=PAPER_ROOM,
            noise=MotionNoise(drive=0.2, turn=0.2, drift=0.02),
            start=Start(sd_position=5.0, sd_heading=0.05),
            driver=Driver(),
        ),
    }
)
