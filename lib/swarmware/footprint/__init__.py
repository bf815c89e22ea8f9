"""Replacements of standard modules that save memory in each process of a node, a file for each.

share/doc/explanation/memory.md has the measured saving of each; a saving below 0.5 MB is not worth a file.
"""
