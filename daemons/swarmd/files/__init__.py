"""The service `files`: stores files from other platforms in one folder, and serves them on request.

The service is optional, and runs where `services` of node.toml lists it.
"""
