"""Compiled arithmetic with the same bits on every processor, for the map and the estimators."""
