"""Decisions of the broker: the beacon protocol, neighbours and routes, boards, admission, forwarding.

It uses no asyncio, zmq, socket, time, random or files: time is an argument, randomness a callable.
"""
