"""Missions: check, start, follow, abort."""
