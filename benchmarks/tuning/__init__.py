"""``deqmcl tune``: the parameters of a localizer that are best on a log."""
