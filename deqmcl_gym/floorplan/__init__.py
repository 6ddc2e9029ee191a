"""The map m: what the world is built of, and the only part of it that a localizer may know.

``FloorPlan`` answers four questions (ranges, collides, free, bounds); ``Lidar`` is the geometry of
the sensor that looks at it. Needs numpy and numba only.
"""

from deqmcl_gym.floorplan.lidar import Lidar
from deqmcl_gym.floorplan.plan import FloorPlan, driven
from deqmcl_gym.floorplan.polygons import Polygon
from deqmcl_gym.numerics.arrays import sincos

__all__ = ["FloorPlan", "Lidar", "Polygon", "driven", "sincos"]
