"""How sans-io cores are run: their contract, the driver of all of them, the report of slow steps.

What decides does not live here, nor what reads, writes or waits for anything but a deadline.
"""
