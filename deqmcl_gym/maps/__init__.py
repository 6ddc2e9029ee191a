"""Maps: the walls of a world, and the only part of it that a localizer may know.

``Map`` is what a map can be asked; ``PolygonMap`` and ``GridMap`` are its forms. ``Office``
generates buildings from a seed. ``Lidar`` is the geometry of the sensor. Needs only numpy and
numba.
"""

from deqmcl_gym.maps.grid_map import GridMap
from deqmcl_gym.maps.lidar import Lidar, Mount
from deqmcl_gym.maps.map import Box, Caster, Map
from deqmcl_gym.maps.office import Office, Offices
from deqmcl_gym.maps.polygons import Polygon, PolygonMap

__all__ = [
    "Box", "Caster", "GridMap", "Lidar", "Map", "Mount", "Office", "Offices", "Polygon",
    "PolygonMap",
]  # fmt: skip
