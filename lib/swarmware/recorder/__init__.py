"""The log of a swarm: entries in MCAP segments and in MongoDB, and one query over both.

Only what logger, operator and reports share; the logger decides what is recorded, and when.
"""
