"""Reliable transport of frames to a neighbour in datagrams: packets, acknowledgements, loss recovery, rate
control, after RFC 9002. One link at a time; routes, sockets and keys are not its subject."""
