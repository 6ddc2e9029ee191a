"""Localizers on recorded logs: ``deqmcl replay``, ``basin`` and ``score``."""
