"""Delivery of messages and requests: decisions on transmissions, answers and outcomes.

Sans-io: time is an argument, no sockets, no clock. `transport.messaging` executes the actions.
"""
