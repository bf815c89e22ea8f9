"""Resources of the swarm as commands use them: list, read, write, show; and one question to many platforms.

Shared by the groups `tree`, `config` and all that read boards; what only one group needs lives in its folder.
"""
