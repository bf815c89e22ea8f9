"""Decisions of the broker, a room each: `beacon`, `membership`, `swarm`, `boards`, `frames`, `reports`.

They use no asyncio, zmq, socket, time, random or files: time is an argument, randomness a callable.
"""
