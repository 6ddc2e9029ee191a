"""Studies of a clone, which are not in the wheel: speed, scores of acting."""
