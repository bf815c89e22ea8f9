"""The master role of a computer: held by one process, taken over by any other (S1.52–57).

Here live the lock with its fencing number, and the duty that comes with it; every process runs both.
"""
