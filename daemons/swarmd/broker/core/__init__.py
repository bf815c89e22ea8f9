"""Decisions of the broker: beacon codec, neighbours, routing, boards, sessions, queues, counters.

No asyncio, zmq, socket, time, random or files in here: time is an argument, chance a callable.
"""
