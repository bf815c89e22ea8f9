"""What tests of modules and daemons stand on: temporary nodes, processes, virtual time, leak checks.

For tests of third-party modules too; nothing here needs pytest.
"""
