"""The map m: what the world is built of, and the only part of it that a localizer may know.

``Map`` is what a map must be able to tell, and ``RollOuts`` what it may; ``PolygonMap`` and
``GridMap`` are its forms; ``Office`` is a building generated from a seed; ``Lidar`` is the geometry
of the sensor that looks at it. Needs numpy and numba only.
"""

from deqmcl_gym.maps.grid_map import GridMap
from deqmcl_gym.maps.lidar import Lidar
from deqmcl_gym.maps.map import Box, Caster, Map, RollOuts
from deqmcl_gym.maps.office import Office
from deqmcl_gym.maps.polygon_map import PolygonMap, driven
from deqmcl_gym.maps.polygons import Polygon

__all__ = [
    "Box",
    "Caster",
    "GridMap",
    "Lidar",
    "Map",
    "Office",
    "Polygon",
    "PolygonMap",
    "RollOuts",
    "driven",
]
