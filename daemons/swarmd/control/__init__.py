"""Control: passes the set-points of the navigator or of an operator on to the chassis, by one table.

Contains no motors and no kill: the service that holds the chassis serves them, without this one.
"""
