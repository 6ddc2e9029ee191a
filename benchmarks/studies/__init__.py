"""Studies, each with a command of its own: ``speed`` (measured ratios) and ``phase`` (a figure)."""
