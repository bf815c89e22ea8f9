"""The structure of a tree: the index of resources, its digest, changes of it, and the own one.

Nothing here knows a subscription or another platform.
"""
