"""The harness: paired trials of localizers in the world, their scores, tables and pictures."""
