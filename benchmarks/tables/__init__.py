"""From scores to tables: trials paired by world, statistics over worlds, the paper's Table 1."""
