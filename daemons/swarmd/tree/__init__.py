"""The resource tree: own resources, the mirrored trees of other platforms, subscriptions, settings.

`core` decides without input or output; the modules beside it read rings, write mirrors and answer requests.
"""
