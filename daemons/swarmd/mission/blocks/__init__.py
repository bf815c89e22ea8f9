"""The functional blocks of vehicles: one file each; the library's catalogue has their types.

Belongs here: what a block does with `context.vehicle`. Not here: when a block starts and ends (the player).
"""
