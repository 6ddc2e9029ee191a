"""What the robot assumes: its start, its motion, its sensor, and which steps are feasible."""
