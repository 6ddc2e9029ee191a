"""The paper's room: 350 × 300 px, with a solid inner rectangle."""

from deqmcl_gym.maps import PolygonMap

PAPER_ROOM = PolygonMap(
    outer=((0, 0), (350, 0), (350, 300), (0, 300)),
    obstacles=(((100, 100), (250, 100), (250, 200), (100, 200)),),
)
