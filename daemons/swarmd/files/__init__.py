"""The service `files`: takes files from other platforms and gives them out, in one folder of the node.

Optional: it runs where `services` of node.toml lists it.
"""
