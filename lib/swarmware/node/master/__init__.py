"""The master role of a computer: held by one process, taken over by any other (S1.52–57).

It has the lock with its fencing number, and the task of the master; every process runs both.
"""
