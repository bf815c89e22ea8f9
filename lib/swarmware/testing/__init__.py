"""Support for tests of modules and daemons: temporary nodes, processes, virtual time, leak checks.

It may be used for third-party modules, too, and does not need pytest.
"""
