"""Signatures of beacons: the own ones, and the checks of those that other members send."""
