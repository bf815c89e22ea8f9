"""The logger: writes the values of a node's resources to a local ring and forwards them to MongoDB.

Formats and stores are in `swarmware.recorder`, together with their readers.
"""
