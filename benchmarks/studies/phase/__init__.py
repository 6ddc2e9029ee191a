"""``deqmcl phase``: the queue drawn as activity of place fields over the theta phase.

The hypothesis of the paper's section 2: a theta cycle holds one queue, read from its past (early
phase) to its future (late phase). See docs/phase.md.
"""
