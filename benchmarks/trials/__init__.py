"""One trial: a lap of one localizer in one world, its scores, and what its numbers depend on."""
