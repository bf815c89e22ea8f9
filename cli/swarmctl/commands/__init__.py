"""A folder for each group of subcommands: module `command` has options and help, the others the logic.

A click function reads the options and makes one call. Logic is a function of a `Session` or an `Output`, so
that a test can call it. A command never imports another command's folder.
"""
