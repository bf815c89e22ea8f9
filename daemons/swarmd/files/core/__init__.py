"""Decisions of the service `files`: which files are accepted, and which incomplete files are evicted."""
