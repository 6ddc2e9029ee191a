"""Pictures and trajectories of laps."""
