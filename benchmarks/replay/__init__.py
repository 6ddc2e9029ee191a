"""Localizers on recorded logs: what they believed at each record, and how far off that was."""
