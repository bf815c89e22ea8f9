"""Decisions of the mission daemon: pure, time is an argument; no input or output of any kind."""
