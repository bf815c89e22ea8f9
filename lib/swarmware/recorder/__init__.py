"""The log of a swarm: entries in MCAP segments and in MongoDB, and one query over both.

Shared by logger, commands and reports; the logger decides what is recorded, and when.
"""
