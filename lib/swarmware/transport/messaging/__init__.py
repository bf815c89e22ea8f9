"""Messages, requests and their answers, to applications of this process, this node and other platforms.

Contains the routing of frames and the Unix sockets between processes; the links between nodes belong to the
broker.
"""
