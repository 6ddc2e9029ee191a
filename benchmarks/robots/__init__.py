"""Logs of real robots: replayed, scored against other stacks, searched for better parameters."""
