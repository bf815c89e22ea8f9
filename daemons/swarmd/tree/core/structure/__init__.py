"""The structure of a tree: the index of resources, its digest, changes of it, and the own one.

Independent of subscriptions and of other platforms.
"""
