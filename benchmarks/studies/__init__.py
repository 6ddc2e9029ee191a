"""Studies, each with a command of its own: speed, phase, scores of acting, training data."""
