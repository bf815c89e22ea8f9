"""What runs cores: their contract, driver and instants; atomic replacement of files, restarts, slow steps.

No decision of a daemon, and nothing of frames, resources or nodes.
"""
