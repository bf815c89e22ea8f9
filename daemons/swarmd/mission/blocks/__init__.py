"""The functional blocks of vehicles: one file each, its type stands in the library's catalogue.

May live here: what a block does, over `context.vehicle`. Not here: when it does it (the player).
"""
