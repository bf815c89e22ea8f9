"""The broker: beacons, neighbours, routing, frames between platforms, rate limits and traffic counters.

`core` decides, `sockets` transport bytes, `exchange` sends and receives beacons and frames, `boards` writes
shared memory, `service` connects them. No other daemon imports this package.
"""
