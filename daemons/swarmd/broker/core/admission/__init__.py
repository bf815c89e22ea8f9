"""Admission of received data: the sender's present session, its rights to a path, the rate of datagrams."""
