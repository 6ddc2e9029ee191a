"""Localizers on recorded logs: ``deqmcl replay`` and ``score``."""
