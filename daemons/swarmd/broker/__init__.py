"""The broker: beacons, neighbours, routing, frames between platforms, rate limits and traffic counters.

`core` decides, `links` transport bytes, `service` connects them. No other daemon imports this package.
"""
