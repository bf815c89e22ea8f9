"""The mission language BDL: loading with positions, block catalogue, checks before anything moves.

May live here: what says what a mission *is* and whether it is sound. Not here: playing it (the mission
daemon), what blocks do (its blocks), anything that waits or sends.
"""
