"""The broker's sockets: UDP datagrams, ZeroMQ over TCP, their keys and byte counts; no decisions."""
