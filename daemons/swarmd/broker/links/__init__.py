"""What moves the broker's bytes: UDP datagrams, ZeroMQ over TCP, their keys and counts. Decides nothing."""
