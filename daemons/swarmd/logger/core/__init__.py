"""Decisions of the logger, without input, output or clock: the recorded values and their rates."""
