"""Sweeps: what is run, running it, and the folder its results are in."""
