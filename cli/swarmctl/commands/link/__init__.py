"""Neighbours of a platform."""
