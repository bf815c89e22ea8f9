"""The operator's command: a folder below `commands/` for each group; this package has their shared code.

Modules that are slow to import are imported in the functions that use them. `swarmlab` is named in one place
only, as a string in the table of commands.
"""
