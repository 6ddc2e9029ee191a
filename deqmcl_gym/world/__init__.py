"""What happens in a world: its parts, its course, physics, sensor and pictures."""
