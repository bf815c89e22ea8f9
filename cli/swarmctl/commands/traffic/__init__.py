"""Counters and rates of a broker."""
