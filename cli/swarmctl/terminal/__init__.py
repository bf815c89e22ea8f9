"""What an operator reads and types: results and messages, progress, confirmations, rates and durations.

Nothing here knows a node or the swarm.
"""
