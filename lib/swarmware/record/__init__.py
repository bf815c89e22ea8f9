"""The record of a swarm: entries in MCAP segments and in MongoDB, and one query over both.

Only what logger, operator and reports share; what is logged when is the logger's decision.
"""
