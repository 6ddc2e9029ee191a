"""Where trials run: in this process, in others of this machine, or on an engine beyond it."""
