"""The operator's command: a folder below `commands/` for each group; here lies what several of them need.

What takes long to import is imported inside the functions that need it. `swarmlab` is named in one place
only, as a string in the table of commands.
"""
