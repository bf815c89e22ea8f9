"""Payload types that cross processes or platforms: one file per area, plus the registry that codes them.

No behaviour beyond what a value says about itself; no daemon's private structures.
"""
