"""Bytes in and out: UDP, ZeroMQ over TCP, serial lines, seals and addresses; no decisions."""
