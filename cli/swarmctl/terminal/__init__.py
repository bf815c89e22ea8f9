"""Input and output of an operator: results and messages, progress, confirmations, rates and durations.

Nothing here knows a node or the swarm.
"""
