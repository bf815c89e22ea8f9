"""Preparation of a lab before its first process starts: plan of the nodes, folders, keys and settings.

The check of what the machine must have (extras, a database that answers) lives here too.
"""
