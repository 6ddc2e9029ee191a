"""The worlds of presets, by name. A module of its own, as its maps are checked by kernels."""

import math
from types import MappingProxyType

from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.world.config import Driver, MotionNoise, Start, World

PAPER_ROOM = PolygonMap(
    outer=((0, 0), (350, 0), (350, 300), (0, 300)),
    obstacles=(((100, 100), (250, 100), (250, 200), (100, 200)),),
)


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
