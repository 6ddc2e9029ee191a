"""Who drives, one file each: ``AGENT`` is called with a ``RobotModel`` and gives an ``Agent``."""
