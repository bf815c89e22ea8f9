"""Checks of this machine and of its node."""
