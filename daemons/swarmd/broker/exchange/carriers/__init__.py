"""The carriers of frames: connections of ZeroMQ, and reliable datagrams; neither knows the other."""
