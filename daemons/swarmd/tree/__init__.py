"""The resource tree: this platform's resources, the mirrored trees of the others, requests, subscriptions, settings.

`core` decides without input or output; the modules beside it read rings, write mirrors and answer requests.
"""
