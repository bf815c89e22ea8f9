"""Decisions of the broker: the beacon protocol, neighbours and routes, boards, admission, forwarding.

No asyncio, zmq, socket, time, random or files in here: time is an argument, chance a callable.
"""
