"""The report of a sweep: one page that explains itself, its numbers, its pictures."""
