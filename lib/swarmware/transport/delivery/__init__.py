"""Delivery of messages and requests, as decisions only: what to send, what to answer, what became of it.

Sans-io: time is an argument, no sockets, no clock. `transport.messaging` carries out what comes back.
"""
