"""The broker: beacons, neighbours, routing, frames between platforms, rate limits and traffic counters.

`core` decides, `links` move bytes, `service` joins them. Nothing here is imported by another daemon.
"""
