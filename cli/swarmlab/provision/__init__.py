"""What a lab has before its first process starts: the plan of its nodes, their folders, keys and settings.

The check of what the machine must have (extras, a database that answers) lives here too.
"""
