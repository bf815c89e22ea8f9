"""The mission language BDL: loading with positions, block catalogue, checks before anything moves.

Belongs here: the model of a mission and its checks. Not here: playing it (the mission
daemon), the actions of blocks (its blocks), anything that waits or sends.
"""
