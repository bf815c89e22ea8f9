"""The broker: links, neighbours, directory, channels and the traffic they carry.

`core` decides, `links` move bytes, `service` joins them. Nothing here is imported by another daemon.
"""
