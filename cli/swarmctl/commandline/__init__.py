"""The command line before a command runs: lazy groups, options of all commands, their settings, completion.

It imports as little as possible besides click: every import delays `swarmctl --help` and each completion.
"""
