"""What the broker decides, without a socket or a clock: tick codec, neighbours, directory, boards, counters.

No asyncio, zmq, socket, time, random or files in here: time is an argument, chance a callable.
"""
