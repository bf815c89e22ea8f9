"""What moves the broker's bytes: UDP datagrams and ZeroMQ over TCP. Decides nothing."""
