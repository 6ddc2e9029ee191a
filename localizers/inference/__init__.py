"""Sequential Monte Carlo over any state space: the queue, the belief, the filter and its parts."""
