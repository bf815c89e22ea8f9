"""The operator's command: `main` has the table of commands, `commands/` a folder for each group of them.

Below the commands, each on top of the next: `vehicles`, `resources`, `session`, `terminal`, `commandline`;
code that two groups share is there. Modules that are slow to import are imported in the functions that use
them. `swarmlab` is named in one place only, as a string in the table of commands.
"""
