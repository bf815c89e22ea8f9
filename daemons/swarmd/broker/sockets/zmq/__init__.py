"""ZeroMQ over TCP: sockets on the event loop, keys of connections, and their byte counts."""
