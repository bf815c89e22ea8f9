"""Decisions of the service `files`: what is taken, and what must go for it."""
