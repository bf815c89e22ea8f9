"""The command line before a command runs: lazy groups, options of all commands, their settings, completion.

Imports click and next to nothing else: `swarmctl --help` and every completion pay for it.
"""
